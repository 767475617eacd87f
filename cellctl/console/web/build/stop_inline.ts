// Puts the STOP button and its script into index.html itself, so that STOP needs nothing else of the page to load.
import { fileURLToPath } from "node:url";
import { build, type Plugin, type Rolldown } from "vite";
import { words as german } from "../src/words/de";
import { words } from "../src/words/en";
import { STOP_WORDS } from "../src/words/stop";

const ENTRY = fileURLToPath(new URL("../src/stop/main.ts", import.meta.url));

async function script(): Promise<string> {
  const made = (await build({
    configFile: false,
    logLevel: "error",
    build: {
      write: false,
      target: "es2020",
      modulePreload: false,
      lib: { entry: ENTRY, formats: ["iife"], name: "stop" },
    },
  })) as Rolldown.RolldownOutput | Rolldown.RolldownOutput[];
  const [first] = Array.isArray(made) ? made : [made];
  const code = first?.output[0].code.trim();
  if (!code || code.includes("</script")) throw new Error("the STOP script cannot be put into index.html");
  return code;
}

function filled(html: string, code: string): string {
  const texts: Record<string, string> = { title: words.title, noScript: `${words.noScript} ${german.noScript}`, stop: STOP_WORDS.en.label, stopAria: STOP_WORDS.en.aria };
  const named = html.replace(/\{\{(\w+)\}\}/g, (_, name: string) => {
    const text = texts[name];
    if (text === undefined) throw new Error(`index.html: no word for ${name}`);
    return text;
  });
  return named.replace("<!-- stop script -->", () => `<script>${code}</script>`);
}

/** Style sheets go behind the STOP script: a script waits for the style sheets before it. */
function stylesBehind(html: string): string {
  const links: string[] = [];
  const without = html.replace(/\s*<link rel="stylesheet"[^>]*>/g, (link) => (links.push(link.trim()), ""));
  return without.replace('<div id="app">', `${links.join("\n    ")}\n    <div id="app">`);
}

/** The plugins. `index.html` holds {{words}} and one `<!-- stop script -->`. */
export function stopInline(): Plugin[] {
  return [
    { name: "stop-inline", transformIndexHtml: { order: "pre", handler: async (html) => filled(html, await script()) } },
    { name: "stop-first", apply: "build", transformIndexHtml: { order: "post", handler: stylesBehind } },
  ];
}

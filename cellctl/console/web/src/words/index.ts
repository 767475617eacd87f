// The words of the page in the language chosen at this browser; changing it loads the page anew.
import { words as de } from "./de";
import { words as en } from "./en";
import { base } from "../api/base";
import { keepLanguage, language, type Language } from "./language";

export type Words = typeof en;

export const words: Words = { en, de }[language];

/** Show the page in another language. Raises if the service does not answer: a page that cannot be loaded has no STOP. */
export async function changeLanguage(next: Language): Promise<void> {
  const answer = await fetch(`${base}/`, { cache: "no-store" });
  if (!answer.ok) throw new Error(words.problems.noAnswer);
  if (keepLanguage(next)) location.reload();
}

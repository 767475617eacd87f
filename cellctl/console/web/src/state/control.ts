// Who has control of the cell: this page, another client, or nobody yet.
import { computed, effect } from "@preact/signals";
import { clientId, post } from "../api/http";
import { words } from "../words";
import { snapshot } from "./cell";
import { told } from "./notices";
import { isOperator, session } from "./session";

const PRESENT_MS = 3000; // well within the time after which a holder counts as absent

/** "ours", "free" (the first command takes it) or "other". */
export const control = computed(() => {
  const held = snapshot.value?.control ?? null;
  if (!held) return "free";
  return held.client === `${session.value?.name}/${clientId}` ? "ours" : "other";
});
export const holder = computed(() => {
  const held = snapshot.value?.control ?? null;
  return held ? words.control.holder(held.holder, held.client.replace(`${held.holder}/`, "")) : "";
});
export const isAbsent = computed(() => snapshot.value?.control?.absent ?? false);
export const mayCommand = computed(() => isOperator.value && control.value !== "other");

/** Why a command is not this page's to give; empty if it is. */
export const whyNot = computed(() => {
  if (!isOperator.value) return words.control.notOperator;
  return control.value === "other" ? words.control.otherHas(holder.value) : "";
});

/** Take control (over), or give it back. True if it was carried out. */
export async function askControl(action: "take" | "release", because: string): Promise<boolean> {
  try {
    await post("/cell/control", { action, because });
    return true;
  } catch (error) {
    told(error);
    return false;
  }
}

/** While this page has control it tells that it is still there. */
export function keepPresent(): void {
  let timer = 0;
  effect(() => {
    clearInterval(timer);
    if (control.value === "ours") timer = window.setInterval(() => void post("/cell/control", { action: "present" }).catch(() => {}), PRESENT_MS);
  });
}

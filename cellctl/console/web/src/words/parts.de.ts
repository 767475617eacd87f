// German words of the page "parts".
import type { parts as english } from "./parts.en";

export const parts: typeof english = {};

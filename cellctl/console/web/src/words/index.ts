// The words of the page in the language chosen at this browser; changing it loads the page anew.
import { words as en } from "./en";

export type Words = typeof en;

export const words: Words = en;
export { stopWords } from "./en";

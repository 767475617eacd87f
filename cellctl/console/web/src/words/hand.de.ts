// German words of the page "hand".
import type { hand as english } from "./hand.en";

export const hand: typeof english = {};

// German words of the page "alarms".
import type { alarms as english } from "./alarms.en";

export const alarms: typeof english = {};

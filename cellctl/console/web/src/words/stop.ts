// The words of STOP stand apart: they are built into index.html with its script.
import { language, type Language } from "./language";

export interface StopWords {
  label: string;
  aria: string;
  because: string;
  sent: string;
  acknowledged: (ms: number, state: string) => string;
  lost: (ms: number) => string;
}

const tenths = (ms: number): string => (ms < 10 ? ms.toFixed(1) : ms.toFixed(0));

export const STOP_WORDS: Record<Language, StopWords> = {
  en: {
    label: "STOP",
    aria: "STOP: laser, powder and motion off at once",
    because: "STOP pressed at the console",
    sent: "STOP sent …",
    acknowledged: (ms, state) => `${state || "Acknowledged"} in ${tenths(ms)} ms`,
    lost: (ms) => `NOT CONFIRMED (${(ms / 1000).toFixed(0)} s): use the E-stop`,
  },
  de: {
    label: "STOP",
    aria: "STOP: Laser, Pulver und Bewegung sofort aus",
    because: "STOP an der Konsole gedrückt",
    sent: "STOP gesendet …",
    acknowledged: (ms, state) => `${state === "STOPPED" || !state ? "GESTOPPT" : state} in ${tenths(ms).replace(".", ",")} ms`,
    lost: (ms) => `NICHT BESTÄTIGT (${(ms / 1000).toFixed(0)} s): Not-Halt benutzen`,
  },
};

export const stopWords: StopWords = STOP_WORDS[language];

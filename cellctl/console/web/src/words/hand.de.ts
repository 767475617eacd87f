// German words of the page "hand".
import type { hand as english } from "./hand.en";

export const hand: typeof english = {
  jog: "Achsen verfahren",
  jogFrame: "Maschinenkoordinaten; der Laser ist gesperrt",
  jogBecause: "am Bedienplatz verfahren",
  notNow: (state: string) => `Nicht möglich, solange die Zelle im Zustand ist: ${state}`,
  step: "Schritt, mm oder °",
  continuous: "halten",
  feed: "Vorschub, mm/min oder °/min",
  holdHint: "Die Achse fährt, solange die Taste gehalten wird; Loslassen, Verlassen der Taste oder der Seite hält sie an.",
  stepHint: "Jeder Druck ist ein Schritt. Die Achse verlässt ihren Verfahrweg nicht.",
  arm: "Tastatur verfährt nicht: freigeben",
  armed: "Tastatur verfährt Achsen (30 s): sperren",
  limits: (letter: string, low: string, high: string, unit: string) => `Verfahrweg von ${letter}: ${low} bis ${high} ${unit}`,
  work: (value: string) => `Werkstück ${value}`,
  move: (letter: string, sense: string, step: string, feed: string) => `${letter} ${sense} verfahren, Schritt ${step}, Vorschub ${feed} je Minute`,

  overrides: "Übersteuern des laufenden Auftrags",
  feedOverride: "Vorschub",
  laser: "Laser",
  powder: "Pulver",
  overrideBecause: "am Bedienplatz geändert",
  window: (low: string, high: string, unit: string) => `Fenster des Werkstoffs ${low} bis ${high} ${unit}`,
  noWindow: "kein Auftrag, der das nutzt: nichts zu ändern",
  anyTime: "Leistung folgt dem Vorschub; jeder Auftrag beginnt mit 100 %",
  bounds: (least: number, most: number) => `${least} bis ${most} %`,
  change: (name: string, delta: number) => `${name} ${delta > 0 ? "plus" : "minus"} ${Math.abs(delta)} Prozent`,
  asProgrammed: (name: string) => `${name} wie programmiert, 100 Prozent`,
};

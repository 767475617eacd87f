// Wörter der Zellen eines Hauses.
import type { cells as english } from "./cells.en";

export const cells: typeof english = {
  title: "Zellen",
  heard: (age) => `vor ${age} gehört`,
  silent: "Nicht gehört",
  lastHeard: (age, state) => `seit ${age}; zuletzt: ${state}`,
  alarms: (count) => (count === 1 ? "1 Alarm" : `${count} Alarme`),
  queued: "Wartende Aufträge",
  unassigned: (count) => (count === 1 ? "1 Auftrag für irgendeine Zelle: noch keine gewählt" : `${count} Aufträge für irgendeine Zelle: noch keine gewählt`),
  shown: "Diese Seite gehört zu dieser Zelle",
  open: (cell) => `${cell} öffnen`,
  noWay: "Ihr Rechner nennt keine Adresse: dort öffnen",
  change: (cell) => `Diese Seite gehört zur Zelle ${cell}; andere wählen`,
  jobFor: "Zelle",
  thisCell: (cell) => `${cell} (diese Zelle)`,
  any: "Irgendeine passende",
};

// Numbers and times as text, as the language of the page writes them.
import { language } from "./language";

const NONE = "–";
const POINT = { en: ".", de: "," }[language];
const LOCALE = { en: "en-GB", de: "de-DE" }[language];

/** A number with fixed decimals as it stands within a sentence. */
export function decimal(value: number, decimals: number): string {
  return value.toFixed(decimals).replace(".", POINT);
}

/** Seconds as h:mm:ss or m:ss. */
export function duration(seconds: number): string {
  if (!Number.isFinite(seconds) || seconds < 0) return NONE;
  const rounded = Math.round(seconds);
  const hours = Math.floor(rounded / 3600);
  const minutes = Math.floor((rounded % 3600) / 60);
  const rest = String(rounded % 60).padStart(2, "0");
  return hours > 0 ? `${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}

/** A short age: 0.3 s, 12 s, 3 min. */
export function age(seconds: number): string {
  if (seconds < 10) return `${decimal(seconds, 1)} s`;
  if (seconds < 120) return `${seconds.toFixed(0)} s`;
  return `${(seconds / 60).toFixed(0)} min`;
}

/** Unix seconds as local time of day. */
export function clock(at: number): string {
  return new Date(at * 1000).toLocaleTimeString(LOCALE);
}

/** Unix seconds as local date and time of day. */
export function moment(at: number): string {
  return new Date(at * 1000).toLocaleString(LOCALE, { dateStyle: "medium", timeStyle: "short" });
}

/** A moment on an axis of time that is `span` seconds long: with seconds, without, or with the date. */
export function axisTime(at: number, span: number): string {
  const date = new Date(at * 1000);
  if (span > 2 * 86_400) return date.toLocaleDateString(LOCALE, { day: "numeric", month: "short" });
  return date.toLocaleTimeString(LOCALE, span > 1200 ? { hour: "2-digit", minute: "2-digit" } : {});
}

/** A number with fixed decimals; a true minus sign, no negative zero. */
export function fixed(value: number | undefined, decimals: number): string {
  if (value === undefined || !Number.isFinite(value)) return NONE;
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? (0).toFixed(decimals) : text.replace("-", "−")).replace(".", POINT);
}

/** Thousands apart. */
export function whole(value: number): string {
  return String(Math.round(value)).replace("-", "−").replace(/\B(?=(\d{3})+$)/g, " ");
}

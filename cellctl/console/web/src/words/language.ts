// The language of the page: chosen at this browser, else what the browser asks for, else English.

export const LANGUAGES = ["en", "de"] as const;
export type Language = (typeof LANGUAGES)[number];

/** Each language in its own words, so that whoever is lost finds the way back. */
export const LANGUAGE_NAMES: Record<Language, string> = { en: "English", de: "Deutsch" };
const KEY = "language";

function known(name: string | null | undefined): Language | undefined {
  return LANGUAGES.find((language) => name?.toLowerCase().startsWith(language));
}

function remembered(): string | null {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // storage is switched off
  }
}

function wanted(): Language {
  for (const name of [remembered(), ...(globalThis.navigator?.languages ?? [])]) {
    const language = known(name);
    if (language) return language;
  }
  return "en";
}

export const language: Language = wanted();

/** Keep the choice for the next time that the page is loaded. False if the browser keeps nothing. */
export function keepLanguage(next: Language): boolean {
  try {
    localStorage.setItem(KEY, next);
    return true;
  } catch {
    return false;
  }
}

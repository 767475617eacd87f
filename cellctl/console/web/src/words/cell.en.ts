// What the cell says about itself. Its own words are English.

export const cell = {
  /** Cause and remedy by the alarm's code; {detail} is what the cell adds. What is not here is told in the cell's own words. */
  alarms: {} as Record<string, readonly [cause: string, remedy: string]>,
  /** A sentence of the cell: why it is in its state, what it waits for, why a condition is not met. */
  said: (text: string): string => text,
};

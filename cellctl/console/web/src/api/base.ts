// Which cell this page is for, by its address: the one of the host that served it, or another's, whose requests that host passes on.

/** "" for the host's own cell, /cells/NAME for another. */
export const base = /^\/cells\/[^/]+(?=\/)/.exec(location.pathname)?.[0] ?? "";

/** The interface of the cell. */
export const api = `${base}/api/v1`;

/** The interface of the host that served the page: who is signed in and which cells there are is known to every host. */
export const houseApi = "/api/v1";

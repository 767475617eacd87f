// Words of the page "parts".

export const parts = {};

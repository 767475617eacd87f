// Words of the page "hand".

export const hand = {};

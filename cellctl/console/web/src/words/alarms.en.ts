// Words of the page "alarms".

export const alarms = {};

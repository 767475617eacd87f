// Words of the cells of a house.
export const cells = {
  title: "Cells",
  heard: (age: string) => `heard ${age} ago`,
  silent: "Not heard",
  lastHeard: (age: string, state: string) => `for ${age}; last: ${state}`,
  alarms: (count: number) => (count === 1 ? "1 alarm" : `${count} alarms`),
  queued: "Jobs waiting",
  unassigned: (count: number) => (count === 1 ? "1 job for any cell: none was chosen yet" : `${count} jobs for any cell: none was chosen yet`),
  shown: "This page is for this cell",
  open: (cell: string) => `Open ${cell}`,
  noWay: "Its host tells no address: open it there",
  change: (cell: string) => `This page is for the cell ${cell}; choose another`,
  jobFor: "Cell",
  thisCell: (cell: string) => `${cell} (this cell)`,
  any: "Any that fits",
};

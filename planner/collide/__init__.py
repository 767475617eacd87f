"""Whether head, cutter and holder have room beside the part as it stands and the plate under it."""

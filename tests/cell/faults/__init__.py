"""The matrix of faults: what goes wrong, in which situation of the cell, and what has to hold then."""

"""The service: takes jobs, runs the cell, shows the operator what happens."""

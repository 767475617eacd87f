"""What the cell may do and when: states, jobs, interlocks and synchronisation as tables and functions."""

"""What FTLab costs, and beside whom: `python -m tests.bench` prints a table, each target met or missed."""

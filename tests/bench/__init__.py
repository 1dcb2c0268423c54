"""What FTLab costs, and beside whom: `python -m tests.bench` prints a table, `test_figures.py` asserts the targets."""

"""Random model files: `python -m tests.fuzz`. What was found is kept in `cases` and read by `tests/test_fuzz.py`."""

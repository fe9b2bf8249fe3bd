"""Fuzz targets: one `fuzz_<decoder>.py` each, with `SEEDS` and `check(data)`.

`check` takes any bytes and must neither raise nor find that a promise of the decoder is
broken. `python -m tests.fuzz` runs them under atheris; see `make fuzz`.
"""

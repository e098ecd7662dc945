"""Frequency responses: from spectra of records, from files, and by harmonic balance.

`frf_files` leads from an entry of `dataset.toml` to FRFs, `spectra` from records; `sines` and `harmonics` say what a
plant answers to a sinusoidal torque, and `resonance` what can be read off a response.
"""

"""Frequency responses: from spectra of records, from files, and by harmonic balance."""

"""The search for what is missing: joint fits, what they are judged by, and what no effect of the catalogue is."""

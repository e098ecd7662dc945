"""Where a plant and measurements disagree, as data that report, pictures and recordings show."""

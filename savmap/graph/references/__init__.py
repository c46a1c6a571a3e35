"""What the user measured: the records, whether they fix the scale and the place, and whether they agree."""

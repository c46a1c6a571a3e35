"""The laboratory: what makes networks and footage with truth. Mapping needs none of it, and no module outside it
imports it."""

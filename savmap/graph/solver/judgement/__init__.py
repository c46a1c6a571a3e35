"""Whether the pictures and the references agree: which of what was given is wrong, and what nothing would notice."""

"""The camera's path along the face by what single frames show of it."""

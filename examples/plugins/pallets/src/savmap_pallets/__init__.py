"""Pallets on the floor before a rack: cuboids of known size, each with a place and a turn. An example of a plugin for savmap."""

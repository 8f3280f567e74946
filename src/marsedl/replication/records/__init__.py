"""Typed artifacts and tables: their fields, their files, what they were made from, and how two files differ."""

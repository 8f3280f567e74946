"""The pages, and the words, formulas and pictures in them."""

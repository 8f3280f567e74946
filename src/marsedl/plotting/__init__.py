"""Style, bands, ellipses; knows no paper."""

"""What papers print, what we find, and the verdicts computed from both."""

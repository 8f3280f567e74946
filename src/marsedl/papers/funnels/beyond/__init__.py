"""Studies of the funnels and checks of what the paper says of them, beyond what it prints."""

"""One vehicle in one uncertain atmosphere, which every method and anybody's law fly: scenarios without claims."""

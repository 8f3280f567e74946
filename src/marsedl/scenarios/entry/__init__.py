"""Entry: the vehicle of the stochastic entry guidance from its interface to a parachute box, under any law."""

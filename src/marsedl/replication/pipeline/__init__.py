"""From inputs to records: what a paper declares, what its code reaches, and the jobs that compute it."""

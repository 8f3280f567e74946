"""Figures from records; knows no paper.

A figure says which field of which record it shows; name, unit and coordinates are those that the record declares:

    trials(axes, closed_loop, "kept_history.altitude")
    plot(axes, gains, "mean.altitude", color=BLACK, label="mean of the design")

- `fields`: what a path means; `Field`, on which figures compute; standard deviations and bounds of ensembles.
- `curves`: `plot`, `trials`, `bounds`, `mark`, notes and legends.
- `forms`: what figures of several papers show: covariances in a plane, a predicted variance against a sampled one, the
  distribution of a sample, the history of an iteration.
- `style`: one look and the colours; figures that are the same bytes whenever they are drawn.
- `ellipses`: geometry of an ellipse, without records.
"""

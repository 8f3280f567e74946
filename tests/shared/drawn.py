"""What figures show."""

from matplotlib.colors import same_color


def curves(axes, color=None, style=None, least=3):
    """Lines with data (those of a legend have none), of a colour and a style if given."""
    return [
        line
        for line in axes.lines
        if len(line.get_xdata()) >= least
        and (color is None or same_color(line.get_color(), color))
        and style in (None, line.get_linestyle())
    ]


def labels(figure):
    """All labels of a figure's legends."""
    legends = [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]
    return [text.get_text() for legend in legends for text in legend.get_texts()]

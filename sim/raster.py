"""The grid cells under a straight line."""


def line_cells(start: tuple[int, int], end: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """The cells (i, j) from one end to the other, both included: one for each step of the longer direction.

    Bresenham's algorithm (IBM Systems Journal 4(1), 1965). Its rounding of exact halves depends on the
    direction of travel, so the line is always walked from its smaller end: the same cells whichever way
    round the ends are given, in the order asked for.
    """
    if start > end:
        return line_cells(end, start)[::-1]
    (i, j), (i_end, j_end) = start, end
    di, dj = abs(i_end - i), abs(j_end - j)
    step_i, step_j = (1 if i_end > i else -1), (1 if j_end > j else -1)
    error = di - dj
    cells = [(i, j)]
    while (i, j) != end:
        doubled = 2 * error
        if doubled > -dj:
            error -= dj
            i += step_i
        if doubled < di:
            error += di
            j += step_j
        cells.append((i, j))
    return tuple(cells)

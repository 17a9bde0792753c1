"""Admittance and its derivatives at `LANES` frequencies at once.

With Phi the diagonal of s and exp(s T), K = Phi - M_xx, elimination of the first columns of
[[K, M_xv], [-M_yx, M_yv]] leaves Y = M_yv + M_yx K^-1 M_xv. Two substitutions more give
R = K^-1 M_xv and L = M_yx K^-1, and dY = [L I] dM [R; I]. All lanes take the same pivots, those of
the greatest sum, and only what couples is looked at.
"""

import numpy as np

from ibrid.fit.just_in_time import OPTIONS, njit
from ibrid.fit.lanes import (
    LANES,
    PARTS,
    WIDTH,
    add_scaled_matrix,
    copy,
    invert,
    magnitude,
    multiply,
    negate,
    put,
    subtract_product,
)

#: Places of a matrix (2, 2).
MATRIX = PARTS * LANES
#: Largest factor of an elimination, in the mean over lanes, whose rounding is of no account.
LARGEST_FACTOR = 1e4
#: A number of the diagonal is taken as the pivot, which keeps zeros, unless another one of the
#: column is so many times its size.
DIAGONAL_PREFERRED = 10.0


def plan_elimination(rows, columns, d_entry, size):
    """What a structure has in common at all values and frequencies, whose M has entries at (rows,
    columns), and derivatives of the entries `d_entry`.

    Of the diagonal numbers the one is eliminated next that fills least (Markowitz).

    Returns a plan: position (size + 2,), where each row and column of M stands in the system;
    couples (size + 2, size + 2) bool, where the system has numbers; first and by_entry, with which
    the derivatives of entry k are by_entry[first[k]:first[k + 1]]. A plain tuple, as compiled code
    that is kept on disk outlives the names of classes.
    """
    couples = np.zeros((size + 2, size + 2), dtype=bool)
    couples[rows, columns] = True
    couples[range(size), range(size)] = True
    couples[size:, size:] = True
    left, order, filled = list(range(size)), list[int](), couples.copy()
    while left:
        within = filled[np.ix_([*left, size, size + 1], [*left, size, size + 1])]
        fill = (within.sum(axis=0) - 1) * (within.sum(axis=1) - 1)
        pivot = left.pop(int(np.argmin(fill[: len(left)])))
        order.append(pivot)
        filled |= np.outer(filled[:, pivot], filled[pivot])
    order += [size, size + 1]
    first = np.concatenate([[0], np.cumsum(np.bincount(d_entry, minlength=len(rows)))])
    return (
        np.argsort(order),
        np.ascontiguousarray(couples[np.ix_(order, order)]),
        first.astype(np.int64),
        np.argsort(d_entry, kind="stable"),
    )


@njit(**OPTIONS)
def lane_workspace(size, parameters):
    """What every group of frequencies fills anew, for a system of that size.

    Returns
    -------
    numbers : (N,) float64, the system (size + 2, size + 2) in lanes, and what `places` tells.
    places : where R (size + 2, 2), L (2, size + 2), a product of both (2, 2), the derivatives (P,
        2, 2), the residuals and the factors of their slopes (2, 2) begin.
    coupled : (size + 2, size + 2) bool, where elimination has left numbers.
    order : (size,) rows of the pivots.
    waiting : (size + 2,) bool, rows that were no pivot.
    behind : (size + 2,) columns that a pivot couples to.
    turn : (size, LANES) d exp(s T) / dT of delays.
    """
    whole = size + 2
    right = whole * whole * WIDTH
    left = right + 2 * whole * WIDTH
    outer = left + 2 * whole * WIDTH
    slopes = outer + MATRIX
    residual = slopes + parameters * MATRIX
    return (
        np.zeros(residual + 2 * MATRIX),
        (right, left, outer, slopes, residual, residual + MATRIX),
        np.zeros((whole, whole), dtype=np.bool_),
        np.zeros(size, dtype=np.int64),
        np.zeros(whole, dtype=np.bool_),
        np.zeros(whole, dtype=np.int64),
        np.zeros((size, LANES), dtype=np.complex128),
    )


@njit(**OPTIONS)
def answer_place(entry, size):
    """The place of an entry of Y: dd, dq, qd, qq."""
    return ((size + entry // 2) * (size + 2) + size + entry % 2) * WIDTH


@njit(**OPTIONS)
def respond_in_lanes(values, rows, columns, delays, s, derivative, plan, space):
    """Y at s (LANES,), to be read at `answer_place`; with `derivative` also L and R.

    False where the pivots that all share are not good enough for each; then nothing holds.
    """
    numbers, places, coupled, order, waiting, behind, turn = space
    position, couples, _, _ = plan
    size = order.size
    whole = size + 2
    for place in range(whole * whole):
        put(numbers, place * WIDTH, 0.0)
    for index in range(rows.size):
        i, j = position[rows[index]], position[columns[index]]
        value = -values[index] if j < size else values[index]
        put(numbers, (i * whole + j) * WIDTH, value)
    for i in range(size):
        at = position[i] * (whole + 1) * WIDTH
        for lane in range(LANES):
            diagonal = s[lane]
            if delays[i] >= 0.0:
                diagonal = np.exp(s[lane] * delays[i])
                turn[i, lane] = -s[lane] * diagonal
            numbers[at + lane] += diagonal.real
            numbers[at + LANES + lane] += diagonal.imag
    if not _eliminate(numbers, couples, coupled, order, waiting, behind):
        return False
    if derivative:
        _substitute(numbers, coupled, order, places[0], places[1])
    return True


@njit(**OPTIONS)
def _eliminate(numbers, couples, coupled, order, waiting, behind):
    size = order.size
    whole = size + 2
    coupled[:, :] = couples
    waiting[:] = True
    for column in range(size):
        best, pivot = 0.0, -1
        for row in range(size):
            if waiting[row] and coupled[row, column]:
                candidate = magnitude(numbers, (row * whole + column) * WIDTH)
                if row == column:
                    candidate *= DIAGONAL_PREFERRED
                if candidate > best:
                    best, pivot = candidate, row
        if pivot < 0:
            return False
        order[column], waiting[pivot] = pivot, False
        begin = pivot * whole
        inverse = (begin + column) * WIDTH
        invert(numbers, inverse)
        count = 0
        for j in range(column + 1, whole):
            if coupled[pivot, j]:
                behind[count] = j
                count += 1
        for row in range(whole):
            if not (waiting[row] and coupled[row, column]):
                continue
            factor = (row * whole + column) * WIDTH
            multiply(numbers, factor, factor, inverse)
            if row < size and not magnitude(numbers, factor) < LARGEST_FACTOR * LANES:
                return False
            for place in range(count):
                j = behind[place]
                at, other = (row * whole + j) * WIDTH, (begin + j) * WIDTH
                subtract_product(numbers, at, factor, other)
                coupled[row, j] = True
    return True


@njit(**OPTIONS)
def _substitute(numbers, coupled, order, right, left):
    """R and L from what elimination leaves, with the unit matrices beside them."""
    size = order.size
    whole = size + 2
    for b in range(2):
        for column in range(size - 1, -1, -1):
            row = order[column]
            at = right + (2 * column + b) * WIDTH
            copy(numbers, at, (row * whole + size + b) * WIDTH)
            for j in range(column + 1, size):
                if coupled[row, j]:
                    known = right + (2 * j + b) * WIDTH
                    subtract_product(numbers, at, (row * whole + j) * WIDTH, known)
            multiply(numbers, at, at, (row * whole + column) * WIDTH)
        for a in range(2):
            put(numbers, right + (2 * (size + a) + b) * WIDTH, 1.0 if a == b else 0.0)
    for a in range(2):
        begin = left + a * whole * WIDTH
        for column in range(size - 1, -1, -1):
            at = begin + order[column] * WIDTH
            copy(numbers, at, ((size + a) * whole + column) * WIDTH)
            for later in range(column + 1, size):
                row = order[later]
                if coupled[row, column]:
                    known = begin + row * WIDTH
                    subtract_product(numbers, at, (row * whole + column) * WIDTH, known)
        for i in range(size):
            negate(numbers, begin + i * WIDTH)
        for b in range(2):
            put(numbers, begin + (size + b) * WIDTH, 1.0 if a == b else 0.0)


@njit(**OPTIONS)
def differentiate_in_lanes(derivatives, rows, columns, d_parameter, delay_parameter, plan, space):
    """The derivatives of Y by the parameters, from L and R."""
    numbers, (right, left, outer, slopes, residual, _), _, order, _, _, turn = space
    position, _, first, by_entry = plan
    size, places = order.size, (left, right, outer)
    for place in range(4 * ((residual - slopes) // MATRIX)):
        put(numbers, slopes + place * WIDTH, 0.0)
    for entry in range(rows.size):
        if first[entry + 1] > first[entry]:
            _multiply_outer(numbers, size, position[rows[entry]], position[columns[entry]], places)
        for place in range(first[entry], first[entry + 1]):
            k = by_entry[place]
            at = slopes + d_parameter[k] * MATRIX
            add_scaled_matrix(numbers, at, outer, derivatives[k])
    for i in range(size):
        if delay_parameter[i] < 0:  # dK = s exp(s T) dT
            continue
        _multiply_outer(numbers, size, position[i], position[i], places)
        for part in range(4):
            at = slopes + delay_parameter[i] * MATRIX + part * WIDTH
            for lane in range(LANES):
                product = outer + part * WIDTH + lane
                added = turn[i, lane] * complex(numbers[product], numbers[product + LANES])
                numbers[at + lane] += added.real
                numbers[at + LANES + lane] += added.imag


@njit(**OPTIONS)
def _multiply_outer(numbers, size, i, j, places):
    """The product of column i of [L I] and row j of [R; I].

    places : of L, R and the product.
    """
    left, right, outer = places
    for a in range(2):
        for b in range(2):
            multiply(
                numbers,
                outer + (2 * a + b) * WIDTH,
                left + (a * (size + 2) + i) * WIDTH,
                right + (2 * j + b) * WIDTH,
            )

"""The first prime numbers: bases of sequences that fill a space of many dimensions evenly.

In different prime bases, mirrored digits have nothing in common; nor have the multiples of the
square roots of different primes, beyond their whole parts (the roots, and one, are linearly
independent over the rational numbers).
"""

from __future__ import annotations

from functools import cache


@cache
def first_primes(count: int) -> tuple[int, ...]:
    """As many prime numbers, ascending.

    >>> first_primes(6)
    (2, 3, 5, 7, 11, 13)
    """
    found: list[int] = []
    candidate = 2
    while len(found) < count:
        if all(candidate % prime for prime in found):
            found.append(candidate)
        candidate += 1
    return tuple(found)

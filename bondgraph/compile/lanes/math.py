"""Functions without branches, which a compiler can work out for several lanes at once; see ``lanes.compiler``.

Largest errors against exact values, in units of the last place of the result, over 2 million random arguments (tests
keep them): ``tanh`` 8, ``exp`` and ``log`` 2, ``arcsin`` and ``arctan`` 3, ``x**y`` 3 and as many as its logarithm to
base two is large; ``sin`` and ``cos`` 3e-16 absolute up to 1e5, and beyond 1e9 they lose digits as a reduction by a
rounded pi does.

Sources: tanh is the continued fraction of Lambert (1768) truncated to a quotient of polynomials of degree 9 and 8, at a
sixteenth of the argument, followed by four doublings; exp reduces by multiples of log 2 and sums its series; sin and
cos reduce by multiples of pi/2 in three parts (Cody and Waite 1980, Software Manual for the Elementary Functions) and
use the polynomials of Cephes (Moshier 1989), as does arctan; arcsin uses the quotient of fdlibm (Sun 1993), log its
series. A power takes the exponent of its base apart from the logarithm of the mantissa, so that whole powers of two in
the result cost no digits.
"""

from __future__ import annotations

import math

import numpy as np


def _lane_tanh(x: float) -> float:
    """Hyperbolic tangent."""
    y = x if x < 20.0 else 20.0
    y = y if y > -20.0 else -20.0
    y = y * 0.0625 if x == x else x
    s = y * y
    top = y * (34459425.0 + s * (4729725.0 + s * (135135.0 + s * (990.0 + s))))
    bottom = 34459425.0 + s * (16216200.0 + s * (945945.0 + s * (13860.0 + s * 45.0)))
    # four times tanh(2 y) = 2 tanh(y) / (1 + tanh(y)^2) on numerator and denominator, with one division at the end
    top, bottom = 2.0 * top * bottom, top * top + bottom * bottom
    top, bottom = 2.0 * top * bottom, top * top + bottom * bottom
    top, bottom = 2.0 * top * bottom, top * top + bottom * bottom
    top, bottom = 2.0 * top * bottom, top * top + bottom * bottom
    return top / bottom


def _lane_exp(x: float) -> float:
    """Exponential function; infinite above 709, zero below -708."""
    y = x if x < 709.0 else 709.0
    y = y if y > -708.0 else -708.0
    k = np.floor(y * 1.4426950408889634 + 0.5)
    r = (y - k * 0.693147180369123816490) - k * 1.90821492927058770002e-10
    value = _lane_scaled(r, k)
    value = np.inf if x > 709.0 else value
    value = 0.0 if x < -708.0 else value
    return value if x == x else x


def _lane_scaled(r: float, k: float) -> float:
    """exp(r) 2**k of an r within half of log 2 and a whole k from -1022 to 1023."""
    p = 1.0 / 479001600.0 + r * (1.0 / 6227020800.0)
    p = 1.0 / 39916800.0 + r * p
    p = 1.0 / 3628800.0 + r * p
    p = 1.0 / 362880.0 + r * p
    p = 1.0 / 40320.0 + r * p
    p = 1.0 / 5040.0 + r * p
    p = 1.0 / 720.0 + r * p
    p = 1.0 / 120.0 + r * p
    p = 1.0 / 24.0 + r * p
    p = 1.0 / 6.0 + r * p
    p = 0.5 + r * p
    p = 1.0 + (r + r * r * p)
    # the last bits of 1.5*2**52 + n are those of n, as in _lane_exponent
    scale = np.int64(np.float64(k + 6755399441056767.0).view(np.int64) << 52).view(np.float64)
    value: float = p * scale
    return value


def _lane_sine(x: float, quarter: float) -> float:
    """sin(x + quarter pi/2)."""
    k = np.floor(x * 0.6366197723675814 + 0.5)
    r = ((x - k * 1.5707963267341256) - k * 6.077100506303966e-11) - k * 2.0222662487959506e-21
    turn = k + quarter
    turn = turn - 4.0 * np.floor(turn * 0.25)
    s = r * r
    p = 1.58962301576546568060e-10
    p = p * s - 2.50507477628578072866e-8
    p = p * s + 2.75573136213857245213e-6
    p = p * s - 1.98412698295895385996e-4
    p = p * s + 8.33333333332211858878e-3
    p = p * s - 1.66666666666666307295e-1
    sine = r + r * s * p
    q = -1.13585365213876817300e-11
    q = q * s + 2.08757008419747316778e-9
    q = q * s - 2.75573141792967388112e-7
    q = q * s + 2.48015872888517045348e-5
    q = q * s - 1.38888888888730564116e-3
    q = q * s + 4.16666666666665929218e-2
    cosine = 1.0 - 0.5 * s + s * s * q
    odd = turn - 2.0 * np.floor(turn * 0.5)
    value: float = cosine if odd > 0.5 else sine
    return -value if turn > 1.5 else value


def _lane_sin(x: float) -> float:
    """Sine."""
    return _lane_sine(x, 0.0)


def _lane_cos(x: float) -> float:
    """Cosine."""
    return _lane_sine(x, 1.0)


def _lane_arcsin(x: float) -> float:
    """Arc sine; nan outside of -1 ... 1."""
    size = abs(x)
    inner = size < 0.5
    t = x * x if inner else 0.5 * (1.0 - size)
    b = size if inner else math.sqrt(t)
    p = 3.47933107596021167570e-05
    p = p * t + 7.91534994289814532176e-04
    p = p * t - 4.00555345006794114027e-02
    p = p * t + 2.01212532134862925881e-01
    p = p * t - 3.25565818622400915405e-01
    p = p * t + 1.66666666666666657415e-01
    q = 7.70381505559019352791e-02
    q = q * t - 6.88283971605453293030e-01
    q = q * t + 2.02094576023350569471e00
    q = q * t - 2.40339491173441421878e00
    q = q * t + 1.0
    r = b + b * (t * p / q)
    outer = 7.85398163397448278999e-01 - (2.0 * r - 7.85398163397448278999e-01)
    value = r if inner else outer
    return -value if x < 0.0 else value


def _lane_arctan(x: float) -> float:
    """Arc tangent."""
    size = abs(x)
    large = size > 2.414213562373095
    small = size <= 0.4142135623730950
    middle = (size - 1.0) / (size + 1.0)
    b = -1.0 / size if large else middle
    b = size if small else b
    start = 1.5707963267948966 if large else 0.7853981633974483
    start = 0.0 if small else start
    z = b * b
    p = -8.750608600031904122785e-01
    p = p * z - 1.615753718733365076637e01
    p = p * z - 7.500855792314704667340e01
    p = p * z - 1.228866684490136173410e02
    p = p * z - 6.485021904942025371773e01
    q = z + 2.485846490142306297962e01
    q = q * z + 1.650270098316988542046e02
    q = q * z + 4.328810604912902668951e02
    q = q * z + 4.853903996359136964868e02
    q = q * z + 1.945506571482613964425e02
    value = start + (b + b * (z * p / q))
    return -value if x < 0.0 else value


def _lane_mantissa(x: float) -> float:
    """Mantissa of a positive number, from the root of 1/2 to the root of 2."""
    y = x * 18014398509481984.0 if x < 2.2250738585072014e-308 else x
    m = np.int64((np.float64(y).view(np.int64) & 4503599627370495) | 4607182418800017408).view(np.float64)
    value: float = 0.5 * m if m > 1.4142135623730951 else m
    return value


def _lane_exponent(x: float) -> float:
    """Power of two by which a positive number is larger than its mantissa."""
    tiny = x < 2.2250738585072014e-308
    y = x * 18014398509481984.0 if tiny else x
    bits = np.float64(y).view(np.int64)
    large = np.int64((bits & 4503599627370495) | 4607182418800017408).view(np.float64) > 1.4142135623730951
    # the bits of 2**52 + n are those of 2**52 and of n: most processors turn no vector of integers into numbers
    k = np.int64((bits >> 52) | 4841369599423283200).view(np.float64) - 4503599627371519.0
    k = k + 1.0 if large else k
    value: float = k - 54.0 if tiny else k
    return value


def _lane_series(f: float) -> float:
    """log(1 + f) - f of a mantissa 1 + f."""
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = 3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01)
    even = 2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860510658591e-01)
    p = 6.666666666666735130e-01 + z * (odd + z * even)
    half = 0.5 * f * f
    return s * (half + z * p) - half


def _lane_log(x: float) -> float:
    """Natural logarithm; minus infinity at zero, nan below."""
    k, f = _lane_exponent(x), _lane_mantissa(x) - 1.0
    value = k * 6.93147180369123816490e-01 + ((_lane_series(f) + k * 1.90821492927058770002e-10) + f)
    value = x if x == np.inf else value
    value = -np.inf if x == 0.0 else value
    return value if x >= 0.0 else np.nan


def _lane_pow(x: float, y: float) -> float:
    """Power, infinite above 2**1023 and zero below 2**-1022; of a base below zero only to whole exponents."""
    size = abs(x)
    k, f = _lane_exponent(size), _lane_mantissa(size) - 1.0
    logarithm = _lane_series(f) + f
    turns = y * k
    whole = np.floor(turns + 0.5)
    rest = (turns - whole) * 0.6931471805599453 + y * logarithm
    more = np.floor(rest * 1.4426950408889634 + 0.5)
    rest = (rest - more * 0.693147180369123816490) - more * 1.90821492927058770002e-10
    total = whole + more
    inside = (total >= -1022.0) & (total <= 1023.0)
    value = _lane_scaled(rest if inside else 0.0, total if inside else 0.0)
    value = np.inf if total > 1023.0 else value
    value = 0.0 if total < -1022.0 else value
    value = (0.0 if y > 0.0 else np.inf) if size == 0.0 else value
    value = (np.inf if y > 0.0 else 0.0) if size == np.inf else value
    odd = y - 2.0 * np.floor(0.5 * y) == 1.0
    negative = -value if odd else value
    negative = negative if np.floor(y) == y else np.nan
    value = negative if x < 0.0 else value
    value = value if (x == x) & (y == y) else np.nan
    return 1.0 if (y == 0.0) | (x == 1.0) else value

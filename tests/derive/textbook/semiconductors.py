"""Circuits with diodes, transistors and other bent characteristics: Chua (1992); Ebers and Moll (1954)."""

from __future__ import annotations

from tests.derive.textbook.case import Case

CASES = (
    Case(
        "half_wave_rectifier",
        """u Se effort: U*sin(w*t)
        j 1
        D R flow: Is*(exp(effort/Vt) - 1)
        z 0
        C C effort: displacement/C
        R R flow: effort/R""",
        "u>j j>D j>z z>C z>R",
        """v = displacement(C)/C
        der displacement(C) = Is*(exp((U*sin(w*t) - v)/Vt) - 1) - v/R""",
        "U=1 w=3 Is=1e-6 Vt=0.2 C=1e-3 R=1e3",
        size={"displacement(C)": 1e-3},
    ),
    Case(
        "diode_with_series_resistance_both_forms",
        """u Se effort: u
        j 1
        Rs R effort: Rs*flow
        D R effort: Vt*log(flow/Is + 1); flow: Is*(exp(effort/Vt) - 1)
        z 0
        C C effort: displacement/C""",
        "u>j j>Rs j>D j>z z>C",
        """v = u - displacement(C)/C
        i = root(lambda x: x - (v - Vt*log(x/Is + 1))/Rs, -Is*(1 - 1e-14), 10.0)
        der displacement(C) = i
        flow j->D = i""",
        "Is=1e-3 Vt=0.2 C=1 Rs=2",
        "u",
    ),
    Case(
        "bridge_rectifier_by_residuals",
        """u Se effort: u
        in 1
        p 0
        q 0
        a 1
        b 1
        c 1
        d 1
        D1 R residual: flow - Is*(exp(effort/Vt) - 1)
        D2 R residual: flow - Is*(exp(effort/Vt) - 1)
        D3 R residual: flow - Is*(exp(effort/Vt) - 1)
        D4 R residual: flow - Is*(exp(effort/Vt) - 1)
        plus 0
        minus 0
        out 1
        C C effort: displacement/C
        ground Se effort: 0""",
        "u>in in>p q>in p>a a>D1 a>plus minus>b b>D2 b>p q>c c>D3 c>plus minus>d d>D4 d>q plus>out out>minus out>C"
        " ground>minus",
        # p - q = u, minus = 0, plus = v: current balance of the source: i1 - i2 = i4 - i3 = current of the source
        """v = displacement(C)/C
        p = root(lambda p: (exp((p - v)/Vt) - exp(-p/Vt)) + (exp((p - u - v)/Vt) - exp((u - p)/Vt)), -5.0, 5.0)
        q = p - u
        i1 = Is*(exp((p - v)/Vt) - 1)
        i3 = Is*(exp((q - v)/Vt) - 1)
        der displacement(C) = i1 + i3""",
        "Is=1e-3 Vt=0.3 C=1",
        "u",
    ),
    Case(
        "van_der_pol",
        """node 0
        C C effort: displacement/C
        L I flow: momentum/L
        G R flow: a*effort**3 - b*effort""",
        "node>C node>L node>G",
        """v = displacement(C)/C
        der displacement(C) = -momentum(L)/L - a*v**3 + b*v
        der momentum(L) = v""",
        "C=1 L=2 a=0.3 b=1",
    ),
    Case(
        "chua",
        """n1 0
        C1 C effort: displacement/C1
        N R flow: Gb*effort + 0.5*(Ga - Gb)*(Abs(effort + E) - Abs(effort - E))
        j 1
        R R effort: R*flow
        n2 0
        C2 C effort: displacement/C2
        L I flow: momentum/L""",
        "n1>C1 n1>N n2>j j>R j>n1 n2>C2 n2>L",
        """v1 = displacement(C1)/C1
        v2 = displacement(C2)/C2
        der displacement(C1) = (v2 - v1)/R - Gb*v1 - 0.5*(Ga - Gb)*(abs(v1 + E) - abs(v1 - E))
        der displacement(C2) = (v1 - v2)/R - momentum(L)/L
        der momentum(L) = v2""",
        "C1=0.1 C2=1 L=0.07 R=1.5 Ga=-0.7 Gb=-0.4 E=1",
    ),
    Case(
        "tunnel_diode",
        """u Se effort: u
        j 1
        R R effort: R*flow
        L I flow: momentum/L
        z 0
        C C effort: displacement/C
        D R flow: effort*(a - b*effort + c*effort**2)""",
        "u>j j>R j>L j>z z>C z>D",
        """v = displacement(C)/C
        der momentum(L) = u - R*momentum(L)/L - v
        der displacement(C) = momentum(L)/L - v*(a - b*v + c*v**2)""",
        "R=1 L=0.5 C=0.2 a=17.76 b=103.79 c=229.62",
        "u",
    ),
    Case(
        "nonlinear_capacitors_in_parallel",
        """i Sf flow: i
        z 0
        C1 C effort: a*displacement + b*displacement**3
        C2 C effort: c*displacement + d*displacement**3""",
        "i>z z>C1 z>C2",
        """v = a*displacement(C1) + b*displacement(C1)**3
        q2 = root(lambda q: c*q + d*q**3 - v, -50.0, 50.0)
        s1 = a + 3*b*displacement(C1)**2
        s2 = c + 3*d*q2**2
        dv = i/(1/s1 + 1/s2)
        der displacement(C1) = dv/s1
        flow z->C2 = dv/s2""",
        "a=1 b=0.5 c=2 d=0.3",
        "i",
    ),
    Case(
        "ebers_moll_transistor",
        """ub Se effort: u_b
        jb 1
        Rb R effort: Rb*flow
        b 0
        uc Se effort: u_c
        jc 1
        Rc R effort: Rc*flow
        c 0
        Cc C effort: displacement/Cc
        Cb C effort: displacement/Cb
        Q R ports: 2; form: flow; laws: ["Is/bf*(exp(effort1/Vt) - 1)", "Is*(exp(effort1/Vt) - 1)*(1 + effort2/Va)"]""",
        "ub>jb jb>Rb jb>b b>Cb b>Q uc>jc jc>Rc jc>c c>Cc c>Q",
        """vb = displacement(Cb)/Cb
        vc = displacement(Cc)/Cc
        k = Is*(exp(vb/Vt) - 1)
        der displacement(Cb) = (u_b - vb)/Rb - k/bf
        der displacement(Cc) = (u_c - vc)/Rc - k*(1 + vc/Va)
        flow b->Q = k/bf
        flow c->Q = k*(1 + vc/Va)""",
        "Rb=10 Rc=2 Cb=1 Cc=1 Is=0.01 bf=50 Vt=0.4 Va=20",
        "u_b u_c",
    ),
)

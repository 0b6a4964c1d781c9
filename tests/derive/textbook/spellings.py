"""What a stranger may write within the format: names, laws, directions of bonds, parts, tables, small structures."""

from __future__ import annotations

from tests.derive.textbook.case import Case, graph_file

MOTOR = graph_file(
    "motor",
    """coil 1
    La I flow: momentum/L
    Ra R effort: R*flow
    gy GY modulus: k_m
    shaft 1
    jm I flow: momentum/J""",
    "coil>La coil>Ra coil>gy gy>shaft shaft>jm",
    "L=0.1 R=2 k_m=0.3 J=0.05",
)
DRIVE = graph_file(
    "drive",
    """m graph graph: @motor; ports: {"plug": "coil", "end": "shaft"}
    twist 0
    k C effort: c*displacement
    out 1
    wheel I flow: momentum/J_w""",
    "m.end>twist twist>k twist>out out>wheel",
    "c=20 J_w=0.4",
    parts={"motor": MOTOR},
)

CASES = (
    Case(
        "names_that_mean_something_to_python_and_sympy",
        """S Se effort: E*sin(beta*t) + Q
        N 1
        I I flow: momentum/I
        lambda R effort: lambda*flow + gamma*flow**3
        C1 C effort: displacement/C1
        z 0
        exp R flow: effort*zeta
        O I flow: momentum/O""",
        "S>N N>I N>lambda N>C1 N>z z>exp z>O",
        """i = momentum(I)/I
        v = (i - momentum(O)/O)/zeta
        der momentum(I) = E*sin(beta*t) + Q - lambda*i - gamma*i**3 - displacement(C1)/C1 - v
        der displacement(C1) = i
        der momentum(O) = v""",
        "E=2 beta=3 I=1.5 lambda=0.4 gamma=0.2 C1=0.7 zeta=2 O=0.3",
        "Q",
    ),
    Case(
        "names_of_the_generated_code",
        # names that the printed module needs for itself
        """np Se effort: rhs
        x 1
        u I flow: momentum/theta_
        dx0 R effort: y*flow
        output C effort: x0*displacement
        abs R effort: min_*Abs(flow)*flow""",
        "np>x x>u x>dx0 x>output x>abs",
        """v = momentum(u)/theta_
        der momentum(u) = rhs - y*v - x0*displacement(output) - min_*abs(v)*v
        der displacement(output) = v""",
        "theta_=2 y=0.3 x0=1.5 min_=0.2",
        "rhs",
    ),
    Case(
        "elements_called_like_their_parameters",
        """F Se effort: F
        v 1
        m I flow: momentum/m
        k C effort: k*displacement
        b R effort: b*flow""",
        "F>v v>m v>k v>b",
        """der momentum(m) = F - k*displacement(k) - b*momentum(m)/m
        der displacement(k) = momentum(m)/m
        out v = momentum(m)/m""",
        "m=2 k=3 b=4",
        "F",
        {"outputs": [{"name": "v", "variable": "flow", "at": "v"}]},
    ),
    Case(
        "sources_at_the_head_of_their_bonds",
        # what is given is imposed on the bond as it stands: effort as it is, flow along the bond
        """v 1
        m I flow: momentum/m
        b R effort: b*flow
        F Se effort: F
        z 0
        k C effort: k*displacement
        Q Sf flow: Q""",
        "v>m v>b v>F v>z z>k z>Q",
        """w = momentum(m)/m
        f = k*displacement(k)
        der momentum(m) = -b*w - F - f
        der displacement(k) = w - Q
        effort v->F = F
        flow v->F = w
        effort z->Q = f
        flow z->Q = Q""",
        "m=2 k=3 b=4",
        "F Q",
    ),
    Case(
        "elements_at_the_tail_of_their_bonds",
        # an element's own flow counts into it: the opposite of the flow of a bond that points away
        """F Se effort: F
        v 1
        m I flow: momentum/m
        b R effort: b*flow + a*flow**2
        k C effort: k*displacement
        z 0
        g R flow: g*effort + h*effort**2
        c C effort: displacement/c
        l I flow: momentum/l""",
        "F>v m>v b>v k>v v>z g>z c>z l>z",
        # m>v: own flow of m is minus the common flow w; own effort (common to bond and element) raises its momentum
        """w = -momentum(m)/m
        own = -w
        e_b = b*own + a*own**2
        e_k = k*displacement(k)
        e = displacement(c)/c
        der momentum(m) = e - F - e_b - e_k
        der displacement(k) = -w
        der displacement(c) = -(-w + g*e + h*e**2 + momentum(l)/l)
        der momentum(l) = e
        flow F->v = w
        flow c->z = -w + g*e + h*e**2 + momentum(l)/l
        flow g->z = -g*e - h*e**2
        effort b->v = e_b""",
        "m=2 k=3 b=4 a=0.5 g=0.6 h=0.2 c=1.5 l=0.8",
        "F",
    ),
    Case(
        "laws_in_both_forms",
        """s Sf flow: i
        z 0
        R R effort: R*flow; flow: effort/R
        C C effort: displacement/C; displacement: C*effort
        j 1
        L I flow: momentum/L; momentum: L*flow
        r R effort: r*flow; flow: effort/r""",
        "s>z z>R z>C z>j j>L j>r",
        """v = displacement(C)/C
        der displacement(C) = i - v/R - momentum(L)/L
        der momentum(L) = v - r*momentum(L)/L""",
        "R=5 C=0.2 L=0.1 r=0.3",
        "i",
    ),
    Case(
        "units_and_domains",
        """F Se effort: F
        v 1 domain: translation
        m I flow: momentum/m
        k C effort: k*displacement; initial: 0.02""",
        "F>v v>m v>k",
        """der momentum(m) = F - k*displacement(k)
        der displacement(k) = momentum(m)/m""",
        "m=2 k=3",
        "F",
        {
            "inputs": [{"name": "F", "unit": "N", "meaning": "push", "default": 1.5}],
            "parameters": [
                {"name": "m", "value": 2.0, "unit": "kg", "bounds": [1, 3]},
                {"name": "k", "value": 3, "unit": "N/m"},
            ],
        },
    ),
    Case(
        "two_levels_of_parts_with_ports",
        """u Se effort: u
        axle graph graph: @drive; ports: {"supply": "m.coil", "hub": "out"}
        j 1
        b R effort: b*flow + a*momentum(axle.m.jm)""",
        "u>axle.supply axle.hub>j j>b",
        """i = momentum(axle.m.La)/0.1
        w = momentum(axle.m.jm)/0.05
        W = momentum(axle.wheel)/0.4
        f = 20*displacement(axle.k)
        der momentum(axle.m.La) = u - 2*i - 0.3*w
        der momentum(axle.m.jm) = 0.3*i - f
        der displacement(axle.k) = w - W
        der momentum(axle.wheel) = f - b*W - a*momentum(axle.m.jm)
        flow axle.m.gy->axle.m.shaft = w""",
        "b=0.7 a=0.2",
        "u",
        parts={"drive": DRIVE},
    ),
    Case(
        "parallel_bonds_to_a_field",
        # both ports of one field on one junction
        """F Se effort: F
        v 1
        X R ports: 2; laws: ["a*flow1 + c*flow2**3", "b*flow2 + d*flow1"]
        m I flow: momentum/m""",
        "F>v v>X v>X v>m",
        """w = momentum(m)/m
        e1 = a*w + c*w**3
        e2 = b*w + d*w
        der momentum(m) = F - e1 - e2
        effort v->X = e1
        effort v->X#2 = e2""",
        "a=1 b=2 c=0.3 d=0.4 m=1.5",
        "F",
    ),
    Case(
        "parallel_bonds_between_junctions_of_two_kinds",
        # a 1-junction bonded twice to a 0-junction, once each way: what goes in comes out, so that the efforts cancel
        """F Se effort: F
        v 1
        z 0
        m I flow: momentum/m
        k C effort: k*displacement""",
        "F>v v>m v>z z>v z>k",
        """der momentum(m) = F
        der displacement(k) = 0.0*F
        flow z->k = 0.0*F""",
        "m=2 k=3",
        "F",
    ),
    Case(
        "junctions_with_two_bonds_and_with_one",
        """F Se effort: F
        a 0
        b 1
        c 1
        d 0
        m I flow: momentum/m
        end 0""",
        "F>a a>b b>c c>d d>m c>end",
        # end has one bond: nothing flows out of it, so the whole chain stands still and its effort is what is left
        """flow F->a = 0.0*F
        effort c->end = F
        effort d->m = 0.0*F""",
        "m=2",
        "F",
    ),
    Case(
        "storage_on_a_zero_source",
        """none Se effort: 0
        z 0
        C C effort: displacement/C
        R R flow: effort/R
        j 1
        L I flow: momentum/L""",
        "none>z z>C z>R z>j j>L",
        """der momentum(L) = 0.0*C
        flow none->z = momentum(L)/L
        flow z->C = 0.0*C""",
        "C=2 R=3 L=4",
    ),
    Case(
        "mass_on_a_wall",
        """wall Sf flow: 0
        v 1
        m I flow: momentum/m
        z 0
        k C effort: k*displacement
        F Sf flow: V""",
        "wall>v v>m F>z z>k z>v",
        """der displacement(k) = V
        effort wall->v = -k*displacement(k)""",
        "m=2 k=3",
        "V",
    ),
    Case(
        "transformer_between_source_and_load_only",
        """u Se effort: u
        T TF modulus: n
        R R effort: R*flow""",
        "u>T T>R",
        """flow u->T = u/n/R/n
        effort T->R = u/n""",
        "n=3 R=2",
        "u",
    ),
    Case(
        "gyrator_onto_a_storage_without_a_junction",
        """i Sf flow: i
        G GY modulus: r
        C C effort: displacement/C""",
        "i>G G>C",
        # effort_out = r flow_in imposes the effort of C: it depends on the input
        """effort G->C = r*i
        flow G->C = C*r*d_i
        effort i->G = r*C*r*d_i""",
        "r=3 C=2",
        "i",
        rates=("i",),
    ),
    Case(
        "constants_from_tiny_to_huge",
        """u Se effort: u
        j 1
        L I flow: momentum/L
        R R effort: R*flow
        z 0
        C C effort: displacement/C
        G R flow: effort/M""",
        "u>j j>L j>R j>z z>C z>G",
        """i = momentum(L)/L
        v = displacement(C)/C
        der momentum(L) = u - R*i - v
        der displacement(C) = i - v/M""",
        "L=1e-7 R=1e-6 C=1e-7 M=1e7",
        "u",
        size={"momentum(L)": 1e-7, "displacement(C)": 1e-7},
    ),
    Case(
        "time_conditions_and_functions_in_laws",
        """F Se effort: Piecewise((F0, t < 1), (F0*exp(-(t - 1)), t < 3), (0, True))
        v 1
        m I flow: momentum/(m*(1 + 0.1*sin(t)))
        b R effort: b*flow*Heaviside(flow) + Min(flow, 0)*c
        k C effort: k*displacement if displacement > 0 else 2*k*displacement
        g Se effort: -sqrt(m**2)*9.81*cos(atan(0.1)) + ln(2) + pow(2, 0.5) + clip(flow(v), -1, 1)""",
        "F>v v>m v>b v>k g>v",
        """v = momentum(m)/(m*(1 + 0.1*sin(t)))
        q = displacement(k)
        F = where(t < 1, F0, where(t < 3, F0*exp(-(t - 1)), 0))
        G = -m*9.81*cos(arctan(0.1)) + log(2) + sqrt(2) + minimum(maximum(v, -1), 1)
        der momentum(m) = F - b*v*(v > 0) - c*minimum(v, 0) - q*where(q > 0, k, 2*k) + G
        der displacement(k) = v""",
        "F0=3 m=2 b=0.4 c=0.7 k=5",
    ),
    Case(
        "tables_in_one_and_two_arguments",
        # points on a line and on a plane: the interpolant between them is exact
        """T Se effort: torque(flow(w), throttle)
        w 1
        J I flow: momentum/J
        d R effort: drag(flow)""",
        "T>w w>J w>d",
        """v = momentum(J)/J
        der momentum(J) = 10 + 2*v + 3*throttle - 0.5*v""",
        "J=2",
        "throttle",
        {
            "tables": {
                "drag": {"x": [-10, -1, 2, 10], "values": [-5, -0.5, 1, 5]},
                "torque": {"x": [-10, 0, 10], "y": [-2, 5], "values": [[-16, 5], [4, 25], [24, 45]]},
            }
        },
    ),
    Case(
        "signals_of_every_kind",
        """F Se effort: -kp*pos - kd*rate + ff
        v 1
        m I flow: momentum/m
        z 0
        k C effort: k*displacement
        w 1
        M I flow: momentum/M
        b R effort: (b + a*squeeze**2)*flow""",
        "F>v v>m v>z z>k z>w w>M w>b",
        """x = momentum(m)/m
        y = momentum(M)/M
        f = k*displacement(k)
        der momentum(m) = -kp*x0 - kd*(x - y) + 2*f + 0.1*momentum(M) - f
        der displacement(k) = x - y
        der momentum(M) = f - (b + a*f**2)*y
        der x0 = x
        out P = f*(x - y)
        out p = momentum(M)
        out q = displacement(k)
        out F_b = (b + a*f**2)*y""",
        "kp=2 kd=0.5 m=1 k=7 M=3 b=0.2 a=0.1",
        head={
            "integrals": [{"name": "x0", "of": "flow(v)", "initial": 0.2}],
            "signals": [
                {"name": "squeeze", "is": "effort(z)"},
                {"name": "rate", "is": "flow(v) - flow(w)"},
                {"name": "pos", "is": "x0"},
                {"name": "ff", "is": "2*effort(k) + 0.1*momentum(M)"},
            ],
            "outputs": [
                {"name": "P", "is": "effort(k)*flow(k)"},
                {"name": "p", "variable": "momentum", "at": "M"},
                {"name": "q", "variable": "displacement", "at": "k"},
                {"name": "F_b", "variable": "effort", "at": "b"},
            ],
        },
    ),
    Case(
        "two_graphs_that_do_not_touch",
        """a 1
        m I flow: momentum/m
        k C effort: k*displacement
        z 0
        C C effort: displacement/C
        R R flow: effort/R""",
        "a>m a>k z>C z>R",
        """der momentum(m) = -k*displacement(k)
        der displacement(k) = momentum(m)/m
        der displacement(C) = -displacement(C)/C/R""",
        "m=1 k=2 C=3 R=4",
    ),
    Case(
        "free_mass_and_charged_capacitor_on_their_own",
        # a storage bonded to a junction of its own, with nothing else: what it holds stays
        """v 1
        m I flow: momentum/m
        z 0
        C C effort: displacement/C""",
        "v>m z>C",
        """der momentum(m) = 0.0*m
        der displacement(C) = 0.0*C""",
        "m=1 C=3",
    ),
    Case(
        "mass_and_spring_bonded_to_each_other",
        """m I flow: momentum/m
        k C effort: k*displacement""",
        "m>k",
        # the flow of the bond is minus the mass's own; it fills the spring; its effort acts on the mass
        """der momentum(m) = k*displacement(k)
        der displacement(k) = -momentum(m)/m""",
        "m=2 k=5",
    ),
)

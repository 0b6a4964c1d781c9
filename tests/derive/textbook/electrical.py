"""Circuits: Karnopp, Margolis and Rosenberg (2012); Borutzky (2010); Desoer and Kuh (1969)."""

from __future__ import annotations

from tests.derive.textbook.case import Case

CASES = (
    Case(
        "series_rlc",
        """u Se effort: u
        loop 1 domain: electrical
        R R effort: R*flow
        L I flow: momentum/L
        C C effort: displacement/C""",
        "u>loop loop>R loop>L loop>C",
        """i = momentum(L)/L
        der momentum(L) = u - R*i - displacement(C)/C
        der displacement(C) = i
        out u_C = displacement(C)/C
        effort loop->R = R*i
        flow u->loop = i""",
        "R=50 L=1e-3 C=1e-6",
        "u",
        {"outputs": [{"name": "u_C", "variable": "effort", "at": "C"}]},
        size={"momentum(L)": 1e-4, "displacement(C)": 1e-6},
    ),
    Case(
        "glc_tank_all_bonds_outward",
        """s Sf flow: i0*cos(w*t)
        node 0
        G R flow: G*effort
        L I flow: momentum/L
        C C effort: displacement/C""",
        "s>node node>G node>L node>C",
        """v = displacement(C)/C
        der displacement(C) = i0*cos(w*t) - G*v - momentum(L)/L
        der momentum(L) = v
        signal effort(node) = v""",
        "i0=0.3 w=5 G=0.02 L=0.2 C=0.4",
    ),
    Case(
        "ladder_of_three",
        """u Se effort: u
        j1 1
        R1 R effort: R1*flow
        n1 0
        C1 C effort: displacement/C1
        j2 1
        R2 R effort: R2*flow
        n2 0
        C2 C effort: displacement/C2
        j3 1
        R3 R effort: R3*flow
        n3 0
        C3 C effort: displacement/C3""",
        "u>j1 j1>R1 j1>n1 n1>C1 n1>j2 j2>R2 j2>n2 n2>C2 n2>j3 j3>R3 j3>n3 n3>C3",
        """v1 = displacement(C1)/C1
        v2 = displacement(C2)/C2
        v3 = displacement(C3)/C3
        a = (u - v1)/R1
        b = (v1 - v2)/R2
        c = (v2 - v3)/R3
        der displacement(C1) = a - b
        der displacement(C2) = b - c
        der displacement(C3) = c
        effort n3->C3 = v3
        flow n1->j2 = b""",
        "R1=1 R2=2 R3=3 C1=1 C2=0.5 C3=0.25",
        "u",
    ),
    Case(
        "bridge_with_storage_in_the_middle",
        """u Se effort: u
        top 0
        a 0
        b 0
        p1 1
        p2 1
        p3 1
        p4 1
        m 1
        R1 R effort: R1*flow
        R2 R effort: R2*flow
        R3 R effort: R3*flow
        R4 R effort: R4*flow
        L I flow: momentum/L
        C C effort: displacement/C""",
        "u>top top>p1 p1>R1 p1>a top>p2 p2>R2 p2>b a>p3 p3>R3 b>p4 p4>R4 a>m m>L m>C m>b",
        """i = momentum(L)/L
        va = (u/R1 - i)/(1/R1 + 1/R3)
        vb = (u/R2 + i)/(1/R2 + 1/R4)
        der momentum(L) = va - vb - displacement(C)/C
        der displacement(C) = i
        effort m->b = vb
        flow a->p3 = va/R3""",
        "R1=10 R2=20 R3=30 R4=45 L=0.1 C=1e-3",
        "u",
    ),
    Case(
        "twin_t_notch",
        """u Se effort: u
        in 0
        ja 1
        Ra R effort: R*flow
        a 0
        Ca C effort: displacement/(2*C)
        jb 1
        Rb R effort: R*flow
        jc 1
        Cc C effort: displacement/C
        b 0
        Rd R flow: 2*effort/R
        jd 1
        Cd C effort: displacement/C
        out 0
        Rl R flow: effort/R_l""",
        "u>in in>ja ja>Ra ja>a a>Ca a>jb jb>Rb jb>out in>jc jc>Cc jc>b b>Rd b>jd jd>Cd jd>out out>Rl",
        """va = displacement(Ca)/(2*C)
        vb = u - displacement(Cc)/C
        vo = vb - displacement(Cd)/C
        ia = (u - va)/R
        ib = (va - vo)/R
        id = vo/R_l - ib
        der displacement(Ca) = ia - ib
        der displacement(Cd) = id
        der displacement(Cc) = 2*vb/R + id
        out v = vo""",
        "R=1000 C=1e-6 R_l=1e5",
        "u",
        {"outputs": [{"name": "v", "variable": "effort", "at": "out"}]},
        size={f"displacement({c})": 1e-6 for c in ("Ca", "Cc", "Cd")},
    ),
    Case(
        "transformer_bonded_to_the_source",
        """u Se effort: u
        T TF modulus: n
        s 1
        R R effort: R*flow
        L I flow: momentum/L
        z 0
        C C effort: displacement/C
        load R flow: effort/R_l""",
        "u>T T>s s>R s>L s>z z>C z>load",
        """i = momentum(L)/L
        v = displacement(C)/C
        der momentum(L) = u/n - R*i - v
        der displacement(C) = i - v/R_l
        flow u->T = i/n
        effort T->s = u/n""",
        "n=4 R=2 L=0.3 C=0.02 R_l=7",
        "u",
    ),
    Case(
        "coupled_coils_by_laws",
        """u Se effort: u
        p 1
        R1 R effort: R1*flow
        coils I ports: 2; laws: ["(L2*momentum1 - M*momentum2)/(L1*L2 - M**2)", \
        "(L1*momentum2 - M*momentum1)/(L1*L2 - M**2)"]
        s 1
        R2 R effort: R2*flow
        C C effort: displacement/C""",
        "u>p p>R1 p>coils s>coils s>R2 s>C",
        """D = L1*L2 - M**2
        i1 = (L2*momentum1(coils) - M*momentum2(coils))/D
        i2 = (L1*momentum2(coils) - M*momentum1(coils))/D
        der momentum1(coils) = u - R1*i1
        der momentum2(coils) = -R2*i2 - displacement(C)/C
        der displacement(C) = i2
        flow p->coils = i1
        flow s->coils = i2""",
        "L1=1 L2=0.5 M=0.4 R1=3 R2=2 C=0.1",
        "u",
    ),
    Case(
        "coupled_coils_in_series",
        """u Se effort: u
        loop 1
        R R effort: R*flow
        coils I ports: 2; energy: (L2*momentum1**2 - 2*M*momentum1*momentum2 + L1*momentum2**2)/(2*(L1*L2 - M**2))""",
        "u>loop loop>coils loop>coils loop>R",
        # one current i: momentum1 = (L1 + M) i, momentum2 = (L2 + M) i
        """i = momentum1(coils)/(L1 + M)
        di = (u - R*i)/(L1 + L2 + 2*M)
        der momentum1(coils) = (L1 + M)*di
        flow u->loop = i
        effort loop->coils = (L1 + M)*di
        effort loop->coils#2 = (L2 + M)*di""",
        "L1=1 L2=0.5 M=0.4 R=3",
        "u",
    ),
    Case(
        "coupled_coils_in_series_seen_from_the_second",
        """u Se effort: u
        loop 1
        R R effort: R*flow
        coils I ports: 2; energy: (L2*momentum1**2 - 2*M*momentum1*momentum2 + L1*momentum2**2)/(2*(L1*L2 - M**2))""",
        "u>loop loop>coils loop>coils loop>R",
        """i = momentum2(coils)/(L2 + M)
        di = (u - R*i)/(L1 + L2 + 2*M)
        der momentum2(coils) = (L2 + M)*di
        flow u->loop = i""",
        "L1=1 L2=0.5 M=0.4 R=3",
        "u",
    ),
    Case(
        "op_amp_integrator_with_high_gain",
        """u Se effort: u
        a 1
        R R effort: R*flow
        minus 0
        f 1
        C C effort: displacement/C
        out 0
        amp Se effort: -A*effort(minus)
        load R flow: effort/R_l""",
        "u>a a>R a>minus minus>f f>C f>out amp>out out>load",
        # v_minus = v_C + v_out, v_out = -A v_minus
        """vm = displacement(C)/C/(1 + A)
        der displacement(C) = (u - vm)/R
        out v_out = -A*vm""",
        "R=1e4 C=1e-6 A=1e6 R_l=1e3",
        "u",
        {"outputs": [{"name": "v_out", "variable": "effort", "at": "out"}]},
        size={"displacement(C)": 1e-6},
    ),
    Case(
        "sallen_key_low_pass",
        """u Se effort: u
        a 1
        R1 R effort: R1*flow
        x 0
        b 1
        R2 R effort: R2*flow
        y 0
        C2 C effort: displacement/C2
        c 1
        C1 C effort: displacement/C1
        buffer Se effort: K*effort(y)""",
        "u>a a>R1 a>x x>b b>R2 b>y y>C2 x>c c>C1 c>buffer",
        """vy = displacement(C2)/C2
        vo = K*vy
        vx = vo + displacement(C1)/C1
        ib = (vx - vy)/R2
        der displacement(C2) = ib
        der displacement(C1) = (u - vx)/R1 - ib
        flow c->buffer = (u - vx)/R1 - ib
        effort c->buffer = vo""",
        "R1=1e4 R2=2e4 C1=1e-7 C2=5e-8 K=1.5",
        "u",
        size={"displacement(C1)": 1e-7, "displacement(C2)": 1e-7},
    ),
    Case(
        "ideal_operational_amplifier_as_a_two_port",
        # a nullor as a two-port R: no voltage and no current at its input, whatever is needed at its output
        """u Se effort: u
        a 1
        R1 R effort: R1*flow
        minus 0
        f 1
        R2 R effort: R2*flow
        C C effort: displacement/C
        out 0
        nullor R ports: 2; residuals: ["effort1", "flow1"]
        load R flow: effort/R_l""",
        "u>a a>R1 a>minus minus>f f>R2 f>C f>out minus>nullor out>nullor out>load",
        """i = u/R1
        vo = -R2*i - displacement(C)/C
        der displacement(C) = i
        effort out->load = vo
        flow out->nullor = i - vo/R_l
        effort minus->nullor = 0.0
        flow minus->nullor = 0.0""",
        "R1=1e3 R2=1e4 C=1e-6 R_l=2e3",
        "u",
        size={"displacement(C)": 1e-6},
    ),
    Case(
        "separately_excited_motor",
        """u_a Se effort: u_a
        a 1 domain: electrical
        La I flow: momentum/La
        Ra R effort: Ra*flow
        u_f Se effort: u_f
        f 1 domain: electrical
        Lf I flow: momentum/Lf
        Rf R effort: Rf*flow
        M GY modulus: K*momentum(Lf)/Lf
        w 1 domain: rotation
        J I flow: momentum/J
        B R effort: b*flow
        load Se effort: -T_l""",
        "u_a>a a>La a>Ra u_f>f f>Lf f>Rf a>M M>w w>J w>B load>w",
        """i = momentum(La)/La
        fi = momentum(Lf)/Lf
        w = momentum(J)/J
        der momentum(La) = u_a - Ra*i - K*fi*w
        der momentum(Lf) = u_f - Rf*fi
        der momentum(J) = K*fi*i - b*w - T_l""",
        "La=0.01 Ra=1 Lf=2 Rf=50 K=0.8 J=0.05 b=0.01",
        "u_a u_f T_l",
    ),
    Case(
        "series_motor_modulated_by_its_own_current",
        """u Se effort: u
        a 1
        L I flow: momentum/L
        R R effort: R*flow
        M GY modulus: K*flow(a)
        w 1
        J I flow: momentum/J""",
        "u>a a>L a>R a>M M>w w>J",
        """i = momentum(L)/L
        der momentum(L) = u - R*i - K*i*momentum(J)/J
        der momentum(J) = K*i**2""",
        "L=0.1 R=2 K=0.5 J=0.3",
        "u",
    ),
    Case(
        "averaged_buck_boost_converter",
        """u Se effort: u
        on TF modulus: 1/d
        j 1
        L I flow: momentum/L
        R R effort: R*flow
        off TF modulus: 1 - d
        z 0
        C C effort: displacement/C
        load R flow: effort/R_l""",
        "u>on on>j j>L j>R j>off off>z z>C z>load",
        """i = momentum(L)/L
        v = displacement(C)/C
        der momentum(L) = d*u - R*i - (1 - d)*v
        der displacement(C) = (1 - d)*i - v/R_l""",
        "L=1e-3 R=0.1 C=1e-4 R_l=10",
        "u d",
        size={"d": 0.5, "momentum(L)": 1e-3, "displacement(C)": 1e-4},
    ),
    Case(
        "two_capacitors_in_parallel",
        """i Sf flow: i
        z 0
        C1 C effort: displacement/C1
        C2 C effort: displacement/C2
        R R flow: effort/R""",
        "i>z z>C1 z>C2 z>R",
        """v = displacement(C1)/C1
        dv = (i - v/R)/(C1 + C2)
        der displacement(C1) = C1*dv
        flow z->C2 = C2*dv""",
        "C1=1 C2=2 R=3",
        "i",
    ),
    Case(
        "capacitor_across_a_voltage_source",
        """u Se effort: u
        z 0
        C C effort: displacement/C
        R R flow: effort/R""",
        "u>z z>C z>R",
        """flow u->z = C*d_u + u/R
        flow z->C = C*d_u
        effort z->C = u""",
        "C=0.5 R=3",
        "u",
        rates=("u",),
    ),
    Case(
        "inductor_cut_set_driven_by_a_current",
        """s Sf flow: i
        n 0
        a 1
        L1 I flow: momentum/L1
        R1 R effort: R1*flow
        b 1
        L2 I flow: momentum/L2
        R2 R effort: R2*flow""",
        "s>n n>a a>L1 a>R1 n>b b>L2 b>R2",
        # i1 + i2 = i: L1 i1' + R1 i1 = L2 i2' + R2 i2
        """i1 = momentum(L1)/L1
        i2 = i - i1
        di1 = (L2*d_i + R2*i2 - R1*i1)/(L1 + L2)
        der momentum(L1) = L1*di1
        effort s->n = L1*di1 + R1*i1""",
        "L1=1 L2=3 R1=5 R2=2",
        "i",
        rates=("i",),
    ),
    Case(
        "rc_line_with_implicit_resistors",
        "u Se effort: u\n"
        + "\n".join(
            f"j{k} 1\nR{k} R residual: effort - r*flow - a*flow**3\nz{k} 0\nC{k} C effort: displacement/c"
            for k in range(1, 9)
        ),
        " ".join(f"{'u' if k == 1 else f'z{k - 1}'}>j{k} j{k}>R{k} j{k}>z{k} z{k}>C{k}" for k in range(1, 9)),
        "\n".join(
            f"i{k} = root(lambda i: r*i + a*i**3 - ({'u' if k == 1 else f'displacement(C{k - 1})/c'}"
            f" - displacement(C{k})/c), -50.0, 50.0)"
            for k in range(1, 9)
        )
        + "\n"
        + "\n".join(f"der displacement(C{k}) = i{k} - {f'i{k + 1}' if k < 8 else '0'}" for k in range(1, 9)),
        "r=1 a=0.5 c=2",
        "u",
    ),
    Case(
        "rc_line_with_resistors_lumped_two_by_two",
        # between the storages stand two nonlinear resistors in series and a linear shunt: loops of two unknowns
        """u Se effort: u
        j1 1
        R1 R residual: effort - r*flow - a*flow**3
        z1 0
        S1 R residual: flow - g*effort - h*effort**3
        j2 1
        R2 R residual: effort - r*flow - a*flow**3
        z2 0
        C2 C effort: displacement/c""",
        "u>j1 j1>R1 j1>z1 z1>S1 z1>j2 j2>R2 j2>z2 z2>C2",
        """v = displacement(C2)/c
        i = lambda d: root(lambda x: r*x + a*x**3 - d, -50.0, 50.0)
        w = root(lambda w: i(u - w) - i(w - v) - g*w - h*w**3, -20.0, 20.0)
        der displacement(C2) = i(w - v)
        effort z1->S1 = w
        flow j1->R1 = i(u - w)""",
        "r=1 a=0.5 c=2 g=0.3 h=0.2",
        "u",
    ),
    Case(
        "gyrated_capacitor_is_an_inductor",
        """u Se effort: u
        j 1
        R R effort: R*flow
        G GY modulus: r
        z 0
        C C effort: displacement/C""",
        "u>j j>R j>G G>z z>C",
        # effort_in = r flow_out, effort_out = r flow_in
        """i = displacement(C)/C/r
        der displacement(C) = (u - R*i)/r
        flow u->j = i""",
        "R=1 r=10 C=0.01",
        "u",
        size={"displacement(C)": 0.1},
    ),
    Case(
        "delta_of_resistors_has_no_states",
        """u Se effort: u
        a 0
        b 0
        c 0
        ab 1
        bc 1
        ca 1
        R1 R effort: R1*flow
        R2 R effort: R2*flow
        R3 R effort: R3*flow
        Ra R flow: effort/R4
        Rc R flow: effort/R5
        s Sf flow: i""",
        "u>b a>ab ab>R1 ab>b b>bc bc>R2 bc>c c>ca ca>R3 ca>a a>Ra c>Rc s>a",
        """A = array([[1/R1 + 1/R3 + 1/R4, -1/R3], [-1/R3, 1/R2 + 1/R3 + 1/R5]])
        v = solve(A, array([i + u/R1, u/R2]))
        out v_a = v[0]
        out v_c = v[1]
        flow u->b = (u - v[0])/R1 + (u - v[1])/R2""",
        "R1=1 R2=2 R3=3 R4=4 R5=5",
        "u i",
        {"outputs": [{"name": "v_a", "variable": "effort", "at": "a"}, {"name": "v_c", "is": "effort(c)"}]},
    ),
)

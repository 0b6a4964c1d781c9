"""Fluids, heat, chemistry and control: Karnopp et al. (2012); Brown (2007); Thoma and Mocellin (2006); Gawthrop and
Crampin (2014); Cellier (1991); Oster, Perelson and Katchalsky (1973)."""

from __future__ import annotations

from tests.derive.textbook.case import Case

CASES = (
    Case(
        "two_tanks_with_orifices",
        """pump Sf flow: Qin
        t1 0 domain: hydraulic
        C1 C effort: rho*g*displacement/A1
        pipe 1
        v12 R flow: K1*sign(effort)*sqrt(Abs(effort))
        t2 0
        C2 C effort: rho*g*displacement/A2
        out R flow: K2*sign(effort)*sqrt(abs(effort))""",
        "pump>t1 t1>C1 t1>pipe pipe>v12 pipe>t2 t2>C2 t2>out",
        """p1 = rho*g*displacement(C1)/A1
        p2 = rho*g*displacement(C2)/A2
        q = K1*sign(p1 - p2)*sqrt(abs(p1 - p2))
        der displacement(C1) = Qin - q
        der displacement(C2) = q - K2*sqrt(p2)
        flow pipe->v12 = q""",
        "rho=1000 g=9.81 A1=0.02 A2=0.03 K1=1e-5 K2=2e-5",
        "Qin",
        size={"Qin": 1e-3},
        signed=False,
    ),
    Case(
        "tank_law_the_other_way_round",
        # the quadratic law of a nozzle is given as a pressure of the flow; an inertance in the pipe imposes the flow
        """t 0
        C C effort: rho*g*displacement/A
        pipe 1
        I I flow: momentum/I
        n R effort: k*flow*Abs(flow)
        amb Se effort: p_a""",
        "t>C t>pipe pipe>I pipe>n pipe>amb",
        """Q = momentum(I)/I
        der displacement(C) = -Q
        der momentum(I) = rho*g*displacement(C)/A - k*Q*abs(Q) - p_a
        effort pipe->amb = p_a
        flow pipe->amb = Q""",
        "rho=1000 g=9.81 A=0.5 I=1e6 k=1e7",
        "p_a",
    ),
    Case(
        "quadratic_law_as_a_residual_between_two_pressures",
        """p Se effort: p
        j 1
        r R residual: effort - k*flow*Abs(flow) - h*flow
        z 0
        C C effort: displacement/C""",
        "p>j j>r j>z z>C",
        """d = p - displacement(C)/C
        q = root(lambda q: k*q*abs(q) + h*q - d, -100.0, 100.0)
        der displacement(C) = q""",
        "k=3 h=0.2 C=0.7",
        "p",
    ),
    Case(
        "gas_accumulator_and_long_pipe",
        """s Se effort: p0*(1 + 0.1*sin(w*t))
        j 1
        I I flow: momentum/I
        R R effort: R*flow
        z 0
        acc C effort: p0*(V0/(V0 - displacement))**n
        load R flow: effort/R_l""",
        "s>j j>I j>R j>z z>acc z>load",
        """p = p0*(V0/(V0 - displacement(acc)))**n
        Q = momentum(I)/I
        der momentum(I) = p0*(1 + 0.1*sin(w*t)) - R*Q - p
        der displacement(acc) = Q - p/R_l""",
        "p0=1e7 V0=1e-2 n=1.4 I=1e7 R=1e9 R_l=1e10 w=5",
        size={"displacement(acc)": 1e-3, "momentum(I)": 1e4},
    ),
    Case(
        "servo_cylinder_with_a_four_way_valve",
        """ps Se effort: p_s
        sup 0
        tank Se effort: 0
        low 0
        ja 1
        va R flow: K*Max(x, 0)*sign(effort)*sqrt(Abs(effort))
        jb 1
        vb R flow: K*Max(x, 0)*sign(effort)*sqrt(Abs(effort))
        a 0
        Ca C effort: beta/V*displacement
        b 0
        Cb C effort: beta/V*displacement
        leak 1
        Rl R effort: R_l*flow
        Ta TF modulus: 1/A
        Tb TF modulus: -1/B
        rod 1
        m I flow: momentum/m
        c R effort: c*flow""",
        "ps>sup sup>ja ja>va ja>a a>Ca a>leak leak>Rl leak>b b>Cb b>jb jb>vb jb>low tank>low a>Ta Ta>rod b>Tb Tb>rod"
        " rod>m rod>c",
        """pa = beta/V*displacement(Ca)
        pb = beta/V*displacement(Cb)
        v = momentum(m)/m
        qa = K*maximum(x, 0)*sign(p_s - pa)*sqrt(abs(p_s - pa))
        qb = K*maximum(x, 0)*sign(pb)*sqrt(abs(pb))
        ql = (pa - pb)/R_l
        der displacement(Ca) = qa - ql - A*v
        der displacement(Cb) = ql - qb + B*v
        der momentum(m) = A*pa - B*pb - c*v
        flow ps->sup = qa""",
        "p_s=2e7 K=1e-6 beta=1.5e9 V=1e-3 R_l=1e12 A=2e-3 B=1.2e-3 m=50 c=300",
        "x",
        size={"x": 1, "displacement(Ca)": 1e-6, "displacement(Cb)": 1e-6, "momentum(m)": 5},
    ),
    Case(
        "hydrostatic_transmission",
        """eng Sf flow: w
        pump TF modulus: D1*a
        line 0
        C C effort: beta*displacement
        leak R flow: G*effort
        motor TF modulus: 1/D2
        shaft 1
        J I flow: momentum/J
        b R effort: b*flow""",
        # a pump: torque = D p, Q = D w, thus effort_in = m effort_out with m = D; flow_out = D w
        "eng>pump pump>line line>C line>leak line>motor motor>shaft shaft>J shaft>b",
        """p = beta*displacement(C)
        W = momentum(J)/J
        der displacement(C) = D1*a*w - G*p - D2*W
        der momentum(J) = D2*p - b*W
        effort eng->pump = D1*a*p""",
        "D1=1e-5 D2=2e-5 beta=1e12 G=1e-12 J=0.3 b=0.1",
        "w a",
        size={"w": 100, "displacement(C)": 1e-5},
    ),
    Case(
        "surge_tank",
        """head Se effort: p0
        tunnel 1
        I I flow: momentum/I
        R R effort: k*flow*abs(flow)
        foot 0
        throat 1
        r R effort: kt*flow*abs(flow)
        C C effort: displacement/Cs
        out Sf flow: Q""",
        "head>tunnel tunnel>I tunnel>R tunnel>foot foot>throat throat>r throat>C foot>out",
        # a source at the head of its bond: its flow is the bond's, hence taken from the junction
        """q = momentum(I)/I
        s = q - Q
        p = displacement(C)/Cs + kt*s*abs(s)
        der momentum(I) = p0 - k*q*abs(q) - p
        der displacement(C) = s
        flow foot->out = Q
        effort foot->out = p""",
        "p0=3 I=2 k=0.3 kt=0.2 Cs=5",
        "Q",
    ),
    Case(
        "heat_through_a_wall_of_five_layers",
        "hot Se effort: T_h\n"
        + "\n".join(
            f"j{i} 1\nR{i} R flow: effort/R\nz{i} 0 domain: thermal\nC{i} C effort: displacement/(m*c)"
            for i in range(1, 6)
        )
        + "\njo 1\nRo R flow: effort/R\ncold Se effort: T_c",
        " ".join(f"{'hot' if i == 1 else f'z{i - 1}'}>j{i} j{i}>R{i} j{i}>z{i} z{i}>C{i}" for i in range(1, 6))
        + " z5>jo jo>Ro jo>cold",
        "T0 = T_h\nT6 = T_c\n"
        + "\n".join(f"T{i} = displacement(C{i})/(m*c)" for i in range(1, 6))
        + "\n"
        + "\n".join(f"der displacement(C{i}) = (T{i - 1} - 2*T{i} + T{i + 1})/R" for i in range(1, 6))
        + "\nflow jo->cold = (T5 - T6)/R",
        "m=2 c=900 R=0.05",
        "T_h T_c",
        size={f"displacement(C{i})": 1e3 for i in range(1, 6)},
    ),
    Case(
        "heat_as_entropy_between_two_bodies",
        # true bonds: temperature and entropy flow; what is conducted makes entropy on the colder side
        """a 0
        Ca C effort: T0*exp(displacement/ca)
        b 0
        Cb C effort: T0*exp(displacement/cb)
        k R ports: 2; form: flow; laws: ["G*(effort1 - effort2)/effort1", "-G*(effort1 - effort2)/effort2"]""",
        "a>Ca b>Cb a>k b>k",
        """Ta = T0*exp(displacement(Ca)/ca)
        Tb = T0*exp(displacement(Cb)/cb)
        Q = G*(Ta - Tb)
        der displacement(Ca) = -Q/Ta
        der displacement(Cb) = Q/Tb
        flow b->k = -Q/Tb""",
        "T0=300 ca=2 cb=5 G=0.1",
    ),
    Case(
        "conduction_towards_the_second_body",
        # the same with the second bond pointing away: the element's own flow is the opposite of the bond's
        """a 0
        Ca C effort: T0*exp(displacement/ca)
        b 0
        Cb C effort: T0*exp(displacement/cb)
        k R ports: 2; form: flow; laws: ["G*(effort1 - effort2)/effort1", "-G*(effort1 - effort2)/effort2"]""",
        "a>Ca b>Cb a>k k>b",
        """Ta = T0*exp(displacement(Ca)/ca)
        Tb = T0*exp(displacement(Cb)/cb)
        Q = G*(Ta - Tb)
        der displacement(Ca) = -Q/Ta
        der displacement(Cb) = Q/Tb
        flow k->b = Q/Tb""",
        "T0=300 ca=2 cb=5 G=0.1",
    ),
    Case(
        "resistor_that_heats_a_body",
        # RS: the electrical port dissipates, the thermal port gives the heat as entropy
        """u Se effort: u
        j 1 domain: electrical
        L I flow: momentum/L
        z 0
        body C effort: T0*exp(displacement/c)
        amb 1
        G R flow: g*effort
        env Se effort: T0
        RS R ports: 2; residuals: ["effort1 - R0*(1 + al*(effort2 - T0))*flow1", "effort1*flow1 + effort2*flow2"]""",
        "u>j j>L j>RS z>RS z>body z>amb amb>G amb>env",
        """T = T0*exp(displacement(body)/c)
        i = momentum(L)/L
        e = R0*(1 + al*(T - T0))*i
        der momentum(L) = u - e
        der displacement(body) = e*i/T - g*(T - T0)
        flow z->RS = -e*i/T""",
        "L=0.5 T0=300 c=40 g=0.01 R0=2 al=0.004",
        "u",
    ),
    Case(
        "reversible_reaction_of_second_order",
        # 2 A + B <-> C, mass action from chemical potentials; stoichiometry by a transformer
        """A 0
        CA C effort: RT*log(KA*displacement)
        B 0
        CB C effort: RT*log(KB*displacement)
        C 0
        CC C effort: RT*log(KC*displacement)
        two TF modulus: 0.5
        f 1
        Re R ports: 2; form: flow; laws: ["k*(exp(effort1/RT) - exp(effort2/RT))", \
        "-k*(exp(effort1/RT) - exp(effort2/RT))"]""",
        "A>CA B>CB C>CC A>two two>f B>f f>Re Re>C",
        # two: flow_out = flow_in/2: the complex takes one for each two of A, with twice the potential
        """a = displacement(CA)
        b = displacement(CB)
        c = displacement(CC)
        v = k*((KA*a)**2*KB*b - KC*c)
        der displacement(CA) = -2*v
        der displacement(CB) = -v
        der displacement(CC) = v""",
        "RT=2.5 KA=1 KB=2 KC=0.5 k=0.4",
        signed=False,
    ),
    Case(
        "michaelis_menten",
        """S 0
        CS C effort: RT*log(KS*displacement)
        E 0
        CE C effort: RT*log(KE*displacement)
        X 0
        CX C effort: RT*log(KX*displacement)
        P 0
        CP C effort: RT*log(KP*displacement)
        f1 1
        r1 1
        f2 1
        r2 1
        R1 R ports: 2; form: flow; laws: ["k1*(exp(effort1/RT) - exp(effort2/RT))", \
        "k1*(exp(effort2/RT) - exp(effort1/RT))"]
        R2 R ports: 2; form: flow; laws: ["k2*(exp(effort1/RT) - exp(effort2/RT))", \
        "k2*(exp(effort2/RT) - exp(effort1/RT))"]""",
        "S>CS E>CE X>CX P>CP S>f1 E>f1 f1>R1 R1>r1 r1>X X>f2 f2>R2 R2>r2 r2>P r2>E",
        """s = KS*displacement(CS)
        e = KE*displacement(CE)
        x = KX*displacement(CX)
        p = KP*displacement(CP)
        v1 = k1*(s*e - x)
        v2 = k2*(x - e*p)
        der displacement(CS) = -v1
        der displacement(CE) = v2 - v1
        der displacement(CX) = v1 - v2
        der displacement(CP) = v2""",
        "RT=2.5 KS=1 KE=2 KX=0.5 KP=1.5 k1=0.4 k2=0.9",
        signed=False,
    ),
    Case(
        "membrane_transport_with_concentrations_as_efforts",
        """o Se effort: c_o
        j 1
        G R flow: P*effort
        i 0
        V C effort: displacement/V
        use R flow: vm*effort/(km + effort)""",
        "o>j j>G j>i i>V i>use",
        """c = displacement(V)/V
        der displacement(V) = P*(c_o - c) - vm*c/(km + c)""",
        "P=0.3 V=2 vm=0.5 km=0.7",
        "c_o",
        signed=False,
    ),
    Case(
        "motor_under_pi_control",
        """drive Se effort: kp*err + ki*z
        a 1
        L I flow: momentum/L
        R R effort: R*flow
        M GY modulus: km
        w 1
        J I flow: momentum/J
        b R effort: b*flow
        load Se effort: -T_l""",
        "drive>a a>L a>R a>M M>w w>J w>b load>w",
        """w = momentum(J)/J
        i = momentum(L)/L
        e = w_ref - w
        der z = e
        der momentum(L) = kp*e + ki*z - R*i - km*w
        der momentum(J) = km*i - b*w - T_l
        out error = e""",
        "kp=2 ki=5 L=0.1 R=1 km=0.3 J=0.02 b=0.01",
        "w_ref T_l",
        {
            "signals": [{"name": "err", "is": "w_ref - flow(w)", "unit": "rad/s"}],
            "integrals": [{"name": "z", "of": "err", "unit": "rad"}],
            "outputs": [{"name": "error", "is": "err"}],
        },
    ),
    Case(
        "inverted_pendulum_with_state_feedback",
        """ctrl Se effort: -k1*x - k2*flow(cart) + k3*q + k4*flow(turn)
        cart 1
        M I flow: momentum/M
        turn 1
        Jp I flow: momentum/Jp
        sx 0
        tx TF modulus: l*cos(q)
        ty TF modulus: -l*sin(q)
        vx 1
        vy 1
        mx I flow: momentum/m
        my I flow: momentum/m
        w Se effort: -m*g""",
        "ctrl>cart cart>M cart>sx turn>tx tx>sx sx>vx vx>mx turn>Jp turn>ty ty>vy vy>my w>vy",
        """v = momentum(M)/M
        w = momentum(Jp)/Jp
        F = -k1*x - k2*v + k3*q + k4*w
        a = solve(array([[M + m, m*l*cos(q)], [m*l*cos(q), Jp + m*l**2]]), array([F + m*l*w**2*sin(q), m*g*l*sin(q)]))
        der momentum(M) = M*a[0]
        der momentum(Jp) = Jp*a[1]
        der x = v
        der q = w""",
        "M=1 m=0.3 l=0.5 Jp=0.05 g=9.81 k1=1 k2=2 k3=30 k4=5",
        head={"integrals": [{"name": "x", "of": "flow(cart)"}, {"name": "q", "of": "flow(turn)"}]},
    ),
    Case(
        "condenser_microphone",
        """u Se effort: E0 + u
        j 1
        R R effort: R*flow
        plate C ports: 2; energy: displacement1**2*(d0 - displacement2)/(2*eA) + k*displacement2**2/2
        p Se effort: F
        v 1
        m I flow: momentum/m
        b R effort: b*flow""",
        "u>j j>R j>plate p>v v>m v>b v>plate",
        """q = displacement1(plate)
        x = displacement2(plate)
        i = (E0 + u - q*(d0 - x)/eA)/R
        der displacement1(plate) = i
        der displacement2(plate) = momentum(m)/m
        der momentum(m) = F - b*momentum(m)/m - k*x + q**2/(2*eA)
        effort v->plate = k*x - q**2/(2*eA)""",
        "E0=5 R=10 d0=2 eA=0.7 k=30 m=0.1 b=0.2",
        "u F",
    ),
    Case(
        "piezo_stack_by_laws_with_force_on_a_dependent_mass",
        """u Se effort: u
        j 1
        R R effort: R*flow
        P C ports: 2; laws: ["a*displacement1 + c*displacement2", "c*displacement1 + b*displacement2"]
        v 1
        m I flow: momentum/m
        F Se effort: -F""",
        "u>j j>R j>P v>P v>m F>v",
        """q = displacement1(P)
        x = displacement2(P)
        der displacement1(P) = (u - a*q - c*x)/R
        der displacement2(P) = momentum(m)/m
        der momentum(m) = -F - c*q - b*x""",
        "a=3 b=5 c=1 R=2 m=0.5",
        "u F",
    ),
    Case(
        "loudspeaker",
        """amp Se effort: u
        coil 1 domain: electrical
        Le I flow: momentum/Le
        Re R effort: Re*flow
        Bl GY modulus: Bl
        cone 1 domain: translation
        Mm I flow: momentum/Mm
        Cm C effort: displacement/Cm
        Rm R effort: Rm*flow
        Sd TF modulus: 1/Sd
        box 0 domain: hydraulic
        Cb C effort: displacement/Cb""",
        # effort_in = m effort_out would need m = Sd on the way to the air
        "amp>coil coil>Le coil>Re coil>Bl Bl>cone cone>Mm cone>Cm cone>Rm box>Sd Sd>cone box>Cb",
        """i = momentum(Le)/Le
        v = momentum(Mm)/Mm
        p = displacement(Cb)/Cb
        der momentum(Le) = u - Re*i - Bl*v
        der momentum(Mm) = Bl*i - displacement(Cm)/Cm - Rm*v + Sd*p
        der displacement(Cm) = v
        der displacement(Cb) = -Sd*v""",
        "Le=5e-4 Re=6 Bl=7 Mm=0.02 Cm=1e-3 Rm=1.5 Sd=0.02 Cb=1e-7",
        "u",
        size={"displacement(Cb)": 1e-5, "momentum(Mm)": 1e-2, "momentum(Le)": 1e-4, "displacement(Cm)": 1e-3},
    ),
)

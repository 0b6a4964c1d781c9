"""Machines: Karnopp, Margolis and Rosenberg (2012); Brown (2007); Goldstein (2002); Mukherjee and Karmakar (2000)."""

from __future__ import annotations

from tests.derive.textbook.case import Case

CASES = (
    Case(
        "quarter_car_on_a_moving_road",
        """road Sf flow: v_r
        tyre 0
        kt C effort: kt*displacement
        wheel 1 domain: translation
        mu I flow: momentum/mu
        wu Se effort: -mu*g
        strut 0
        rel 1
        ks C effort: ks*displacement + k3*displacement**3
        bs R effort: bs*flow*(1 + 0.5*tanh(flow/0.1))
        body 1 domain: translation
        ms I flow: momentum/ms
        ws Se effort: -ms*g""",
        "road>tyre tyre>kt tyre>wheel wheel>mu wu>wheel wheel>strut strut>rel rel>ks rel>bs strut>body body>ms ws>body",
        """vu = momentum(mu)/mu
        vs = momentum(ms)/ms
        v = vu - vs
        F = ks*displacement(ks) + k3*displacement(ks)**3 + bs*v*(1 + 0.5*tanh(v/0.1))
        der displacement(kt) = v_r - vu
        der momentum(mu) = kt*displacement(kt) - F - mu*g
        der displacement(ks) = v
        der momentum(ms) = F - ms*g
        flow rel->ks = v
        effort strut->body = F""",
        "kt=2e5 mu=40 ks=2e4 k3=1e5 bs=1500 ms=300 g=9.81",
        "v_r",
        size={"displacement(kt)": 0.01, "displacement(ks)": 0.05, "momentum(ms)": 300, "momentum(mu)": 40},
    ),
    Case(
        "half_car_that_heaves_and_pitches",
        # corners move with v + a w and v - b w; the arms are transformers of pitch rate to corner speed
        """heave 1
        m I flow: momentum/m
        weight Se effort: -m*g
        pitch 1
        J I flow: momentum/J
        af TF modulus: a
        ar TF modulus: -b
        cf 1
        cr 1
        kf C effort: kf*displacement
        bf R effort: bf*flow
        kr C effort: kr*displacement
        br R effort: br*flow
        rel_f 1
        rel_r 1
        road_f Sf flow: v_f
        road_r Sf flow: v_r
        gf 0
        gr 0""",
        # strut force acts from the road on heave and, through the arm, on pitch
        "weight>heave heave>m pitch>J"
        " road_f>gf gf>rel_f rel_f>kf rel_f>bf gf>heave gf>cf cf>af af>pitch"
        " road_r>gr gr>rel_r rel_r>kr rel_r>br gr>heave gr>cr cr>ar ar>pitch",
        """v = momentum(m)/m
        w = momentum(J)/J
        rf = v_f - (v + w/a)
        rr = v_r - (v - w/b)
        Ff = kf*displacement(kf) + bf*rf
        Fr = kr*displacement(kr) + br*rr
        der momentum(m) = Ff + Fr - m*g
        der momentum(J) = Ff/a - Fr/b
        der displacement(kf) = rf
        der displacement(kr) = rr
        flow af->pitch = w""",
        "m=800 J=900 a=0.9 b=0.7 kf=2e4 kr=3e4 bf=1e3 br=2e3 g=9.81",
        "v_f v_r",
        size={"momentum(m)": 800, "momentum(J)": 900, "displacement(kf)": 0.05, "displacement(kr)": 0.05},
    ),
    Case(
        "lever_joins_two_masses",
        """F Se effort: F
        a 1
        m1 I flow: momentum/m1
        lever TF modulus: l1/l2
        b 1
        m2 I flow: momentum/m2
        k C effort: k*displacement""",
        "F>a a>m1 a>lever lever>b b>m2 b>k",
        # flow_out = m flow_in, effort_in = m effort_out
        """n = l1/l2
        v1 = momentum(m1)/m1
        dv = (F - n*k*displacement(k))/(m1 + n**2*m2)
        der momentum(m1) = m1*dv
        der displacement(k) = n*v1
        effort lever->b = k*displacement(k) + m2*n*dv
        effort b->m2 = m2*n*dv""",
        "m1=1 m2=2 l1=0.3 l2=0.7 k=40",
        "F",
    ),
    Case(
        "planetary_gear",
        # ring speed = (1 + r) carrier - r sun: weights of flows by transformers into a 1-junction of the teeth
        """Ts Se effort: T_s
        sun 1
        Js I flow: momentum/Js
        Tc Se effort: T_c
        carrier 1
        Jc I flow: momentum/Jc
        ring 1
        Jr I flow: momentum/Jr
        br R effort: b*flow
        ts TF modulus: -r
        tc TF modulus: 1 + r
        mesh 0""",
        "Ts>sun sun>Js sun>ts ts>mesh Tc>carrier carrier>Jc carrier>tc tc>mesh mesh>ring ring>Jr ring>br",
        """ws = momentum(Js)/Js
        wc = momentum(Jc)/Jc
        wr = (1 + r)*wc - r*ws
        M = array([[Js + r**2*Jr, -r*(1 + r)*Jr], [-r*(1 + r)*Jr, Jc + (1 + r)**2*Jr]])
        a = solve(M, array([T_s + r*b*wr, T_c - (1 + r)*b*wr]))
        der momentum(Js) = Js*a[0]
        der momentum(Jc) = Jc*a[1]
        flow mesh->ring = wr""",
        "Js=0.1 Jc=0.5 Jr=0.3 r=0.4 b=0.2",
        "T_s T_c",
    ),
    Case(
        "pendulum_on_a_cart",
        """F Se effort: F
        cart 1
        M I flow: momentum/M
        turn 1
        J I flow: momentum/J
        x 0
        tx TF modulus: l*cos(theta)
        ty TF modulus: l*sin(theta)
        bobx 1
        boby 1
        mx I flow: momentum/m
        my I flow: momentum/m
        w Se effort: -m*g""",
        "F>cart cart>M cart>x turn>tx tx>x x>bobx bobx>mx turn>J turn>ty ty>boby boby>my w>boby",
        """q = theta
        X = momentum(M)/M
        w = momentum(J)/J
        A = array([[M + m, m*l*cos(q)], [m*l*cos(q), J + m*l**2]])
        a = solve(A, array([F + m*l*w**2*sin(q), -m*g*l*sin(q)]))
        der momentum(M) = M*a[0]
        der momentum(J) = J*a[1]
        der theta = w""",
        "M=2 m=0.5 l=0.8 J=0.1 g=9.81",
        "F",
        {"integrals": [{"name": "theta", "of": "flow(turn)", "unit": "rad"}]},
    ),
    Case(
        "double_pendulum",
        """one 1
        J1 I flow: momentum/J1
        two 1
        J2 I flow: momentum/J2
        a1 TF modulus: l1*cos(q1)
        b1 TF modulus: l1*sin(q1)
        a2 TF modulus: l2*cos(q2)
        b2 TF modulus: l2*sin(q2)
        x1 1
        y1 1
        mx1 I flow: momentum/m1
        my1 I flow: momentum/m1
        w1 Se effort: -m1*g
        sx 0
        sy 0
        x2 1
        y2 1
        mx2 I flow: momentum/m2
        my2 I flow: momentum/m2
        w2 Se effort: -m2*g""",
        "one>J1 two>J2 one>a1 a1>x1 one>b1 b1>y1 x1>mx1 y1>my1 w1>y1 x1>sx y1>sy two>a2 a2>sx two>b2 b2>sy"
        " sx>x2 sy>y2 x2>mx2 y2>my2 w2>y2",
        """w1 = momentum(J1)/J1
        w2 = momentum(J2)/J2
        c = m2*l1*l2*cos(q1 - q2)
        s = m2*l1*l2*sin(q1 - q2)
        A = array([[J1 + (m1 + m2)*l1**2, c], [c, J2 + m2*l2**2]])
        a = solve(A, array([-s*w2**2 - (m1 + m2)*g*l1*sin(q1), s*w1**2 - m2*g*l2*sin(q2)]))
        der momentum(J1) = J1*a[0]
        der momentum(J2) = J2*a[1]
        der q1 = w1
        der q2 = w2""",
        "J1=0.1 J2=0.2 m1=1 m2=0.6 l1=0.5 l2=0.7 g=9.81",
        head={"integrals": [{"name": "q1", "of": "flow(one)"}, {"name": "q2", "of": "flow(two)"}]},
    ),
    Case(
        "slider_crank_engine",
        # gas spring on the piston; x(q) = r cos q + sqrt(l^2 - r^2 sin^2 q)
        """crank 1
        J I flow: momentum/J
        load R effort: b*flow
        rod TF modulus: -(r*sin(q) + r**2*sin(q)*cos(q)/sqrt(l**2 - r**2*sin(q)**2))
        piston 1
        m I flow: momentum/m
        gas C effort: -p0*A*((V0/(V0 - A*displacement))**gamma - 1)
        F R effort: c*flow""",
        "crank>J crank>load crank>rod rod>piston piston>m piston>F piston>gas",
        """root_ = sqrt(l**2 - r**2*sin(q)**2)
        T = -(r*sin(q) + r**2*sin(q)*cos(q)/root_)
        dT = -(r*cos(q) + r**2*(cos(q)**2 - sin(q)**2)/root_ + r**4*sin(q)**2*cos(q)**2/root_**3)
        w = momentum(J)/J
        v = T*w
        G = -p0*A*((V0/(V0 - A*displacement(gas)))**gamma - 1)
        a = (-b*w - T*(c*v + G + m*dT*w**2))/(J + m*T**2)
        der momentum(J) = J*a
        der displacement(gas) = v
        der q = w
        flow rod->piston = v
        effort piston->m = m*(T*a + dT*w**2)""",
        "J=0.05 b=0.02 r=0.04 l=0.13 m=0.4 p0=1e5 A=5e-3 V0=4e-4 gamma=1.3 c=30",
        head={"integrals": [{"name": "q", "of": "flow(crank)"}]},
        size={"displacement(gas)": 0.02},
    ),
    Case(
        "elastic_pendulum_in_polar_coordinates",
        # radial mass, tangential mass moved by r(t) times the angular speed; r is the displacement of the spring
        """radial 1
        mr I flow: momentum/m
        k C effort: k*displacement
        angular 1
        Jq I flow: momentum/J
        arm TF modulus: l + displacement(k)
        tangential 1
        mt I flow: momentum/m
        gr Se effort: m*g*cos(q) + m*(l + displacement(k))*flow(angular)**2
        gt Se effort: -m*g*sin(q) - m*flow(radial)*flow(angular)""",
        "radial>mr radial>k gr>radial angular>Jq angular>arm arm>tangential tangential>mt gt>tangential",
        """r = l + displacement(k)
        w = momentum(Jq)/J
        v = momentum(mr)/m
        der momentum(mr) = m*g*cos(q) + m*r*w**2 - k*displacement(k)
        der displacement(k) = v
        der momentum(Jq) = J*(-m*g*r*sin(q) - 2*m*r*v*w)/(J + m*r**2)
        der q = w""",
        "m=1 k=50 l=1 J=0.1 g=9.81",
        head={"integrals": [{"name": "q", "of": "flow(angular)"}]},
        size={"displacement(k)": 0.1},
    ),
    Case(
        "rigid_body_with_torques_and_a_rotor",
        """x 1
        y 1
        z 1
        Ix I flow: momentum/Jx
        Iy I flow: momentum/Jy
        Iz I flow: momentum/Jz
        gx GY modulus: Jx*flow(x)
        gy GY modulus: Jy*flow(y)
        gz GY modulus: momentum(Iz) + h
        Tx Se effort: T
        bz R effort: b*flow""",
        "x>Ix y>Iy z>Iz x>gz gz>y y>gx gx>z z>gy gy>x Tx>x z>bz",
        """wx = momentum(Ix)/Jx
        wy = momentum(Iy)/Jy
        wz = momentum(Iz)/Jz
        der momentum(Ix) = T + Jy*wy*wz - (Jz*wz + h)*wy
        der momentum(Iy) = (Jz*wz + h)*wx - Jx*wx*wz
        der momentum(Iz) = Jx*wx*wy - Jy*wy*wx - b*wz""",
        "Jx=1 Jy=2 Jz=3 h=0.7 b=0.1",
        "T",
    ),
    Case(
        "bouncing_ball",
        """ball 1
        m I flow: momentum/m
        weight Se effort: -m*g
        floor C effort: -k*Max(-displacement, 0)
        pad R effort: c*Heaviside(-displacement(floor))*flow
        air R effort: cw*flow*Abs(flow)""",
        "weight>ball ball>m ball>floor ball>pad ball>air",
        """y = displacement(floor)
        v = momentum(m)/m
        der momentum(m) = -m*g + k*maximum(-y, 0) - where(y <= 0, c, 0)*v - cw*v*abs(v)
        der displacement(floor) = v""",
        "m=0.2 g=9.81 k=1e4 c=3 cw=0.01",
        size={"displacement(floor)": 0.01},
    ),
    Case(
        "ball_as_a_piecewise_contact",
        """ball 1
        m I flow: momentum/m; initial: -0.3
        weight Se effort: -m*g
        floor C effort: Piecewise((k*displacement, displacement < 0), (0, True)); initial: 1.0""",
        "weight>ball ball>m ball>floor",
        """y = displacement(floor)
        der momentum(m) = -m*g - where(y < 0, k*y, 0.0)
        der displacement(floor) = momentum(m)/m""",
        "m=0.2 g=9.81 k=1e4",
        size={"displacement(floor)": 0.01},
    ),
    Case(
        "beam_by_twenty_modes",
        # simply supported Euler-Bernoulli beam: modal mass mu l/2, stiffness EI (i pi/l)^4 l/2, force at x0
        "force Se effort: F\npoint 1\ntip 0\n"
        + "\n".join(
            f"q{i} 1\nm{i} I flow: momentum/(mu*l/2)\nk{i} C effort: EI*({i}*pi/l)**4*l/2*displacement\n"
            f"b{i} R effort: d*{i}*flow\nt{i} TF modulus: 1/sin({i}*pi*x0/l)"
            for i in range(1, 21)
        ),
        "force>point point>tip " + " ".join(f"tip>t{i} t{i}>q{i} q{i}>m{i} q{i}>k{i} q{i}>b{i}" for i in range(1, 21)),
        "\n".join(
            f"v{i} = momentum(m{i})/(mu*l/2)\n"
            f"der momentum(m{i}) = F*sin({i}*pi*x0/l) - EI*({i}*pi/l)**4*l/2*displacement(k{i}) - d*{i}*v{i}\n"
            f"der displacement(k{i}) = v{i}"
            for i in range(1, 21)
        )
        + "\nflow force->point = "
        + " + ".join(f"v{i}*sin({i}*pi*x0/l)" for i in range(1, 21)),
        "mu=0.8 l=2 EI=30 x0=0.73 d=0.02",
        "F",
    ),
    Case(
        "chain_of_twenty_masses_with_bonds_both_ways",
        # bonds point from the free end to the wall; those of every other spring and damper point away from it, so that
        # its own flow is the opposite of the bond's
        "wall Sf flow: 0\n"
        + "\n".join(
            f"v{i} 1\nm{i} I flow: momentum/m\nz{i} 0\nr{i} 1\nk{i} C effort: k*displacement\nb{i} R effort: b*flow"
            for i in range(20)
        ),
        " ".join(
            f"v{i}>m{i} v{i}>z{i} z{i}>{f'v{i - 1}' if i else 'wall'} z{i}>r{i} "
            + (f"r{i}>k{i} r{i}>b{i}" if i % 2 else f"k{i}>r{i} b{i}>r{i}")
            for i in range(20)
        ),
        "\n".join(f"w{i} = momentum(m{i})/m" for i in range(20))
        + "\n"
        + "\n".join(
            f"x{i} = w{i} - {f'w{i - 1}' if i else '0'}\n"
            f"F{i} = {'' if i % 2 else '-'}k*displacement(k{i}) + b*x{i}\n"
            f"der displacement(k{i}) = {'' if i % 2 else '-'}x{i}"
            for i in range(20)
        )
        + "\n"
        + "\n".join(f"der momentum(m{i}) = {f'F{i + 1}' if i < 19 else '0'} - F{i}" for i in range(20)),
        "m=0.5 k=100 b=0.3",
    ),
    Case(
        "stick_slip_on_a_belt",
        """belt Sf flow: v0
        z 0
        rel 1
        dry R effort: Fc*tanh(flow/vs)*(1 + a*exp(-(flow/vs)**2))
        block 1
        m I flow: momentum/m
        k C effort: k*displacement""",
        "belt>z z>rel rel>dry z>block block>m block>k",
        """v = momentum(m)/m
        x = v0 - v
        der momentum(m) = Fc*tanh(x/vs)*(1 + a*exp(-(x/vs)**2)) - k*displacement(k)
        der displacement(k) = v""",
        "v0=0.5 Fc=2 vs=0.1 a=0.4 m=1 k=10",
    ),
    Case(
        "maxwell_kelvin_and_zener_in_series",
        """F Se effort: F
        v 1
        M I flow: momentum/M
        c 0
        kv 1
        k1 C effort: k1*displacement
        b1 R effort: b1*flow
        k2 C effort: k2*displacement
        b2 R flow: effort/b2
        wall Sf flow: 0""",
        # v = rate of a Kelvin element + rate of a spring + rate of a damper, all carrying one force
        "F>v v>M v>c c>k2 c>b2 c>kv kv>k1 kv>b1 c>wall",
        """f = k2*displacement(k2)
        d1 = (f - k1*displacement(k1))/b1
        der momentum(M) = F - f
        der displacement(k1) = d1
        der displacement(k2) = momentum(M)/M - f/b2 - d1""",
        "M=2 k1=30 b1=4 k2=50 b2=7",
        "F",
    ),
    Case(
        "mass_moved_with_a_given_speed",
        """v Sf flow: V*sin(w*t) + u
        j 1
        m I flow: momentum/m
        b R effort: b*flow""",
        "v>j j>m j>b",
        """s = V*sin(w*t) + u
        effort v->j = m*(V*w*cos(w*t) + d_u) + b*s
        effort j->m = m*(V*w*cos(w*t) + d_u)
        out P = (m*(V*w*cos(w*t) + d_u) + b*s)*s""",
        "V=1 w=3 m=2 b=0.5",
        "u",
        {"outputs": [{"name": "P", "is": "effort(v)*flow(v)"}]},
        rates=("u",),
    ),
    Case(
        "relativistic_mass_on_a_hardening_spring_by_energies",
        """j 1
        m I energy: c**2*sqrt(m**2 + momentum**2/c**2)
        k C energy: k*displacement**2/2 + a*displacement**4/4
        b R effort: b*flow*Abs(flow)""",
        "j>m j>k j>b",
        """v = momentum(m)/sqrt(m**2 + momentum(m)**2/c**2)
        q = displacement(k)
        der momentum(m) = -k*q - a*q**3 - b*v*abs(v)
        der displacement(k) = v""",
        "m=1 c=2 k=3 a=0.7 b=0.2",
    ),
    Case(
        "masses_one_relativistic_rigidly_joined",
        # p2 follows from the common speed; its slope dp/dv = m0/(1 - v^2/c^2)^(3/2)
        """F Se effort: F
        j 1
        m1 I flow: momentum/m1
        m2 I flow: momentum/sqrt(m2**2 + momentum**2/c**2)
        b R effort: b*flow""",
        "F>j j>m1 j>m2 j>b",
        """v = momentum(m1)/m1
        s = m2/(1 - v**2/c**2)**1.5
        dv = (F - b*v)/(m1 + s)
        der momentum(m1) = m1*dv
        effort j->m2 = s*dv""",
        "m1=1 m2=0.5 c=4 b=0.3",
        "F",
    ),
    Case(
        "rolling_disc_pulls_a_hanging_weight",
        """disc 1
        J I flow: momentum/J
        roll TF modulus: R
        centre 1
        M I flow: momentum/M
        rope 0
        kr C effort: k*displacement
        hang 1
        m I flow: momentum/m
        w Se effort: m*g""",
        "disc>J disc>roll roll>centre centre>M w>hang hang>m hang>rope rope>kr rope>centre",
        """W = momentum(J)/J
        v = R*W
        f = k*displacement(kr)
        u = momentum(m)/m
        der momentum(J) = J*(R*f)/(J + M*R**2)
        der momentum(m) = m*g - f
        der displacement(kr) = u - v""",
        "J=0.2 R=0.3 M=1.5 m=0.7 k=300 g=9.81",
    ),
    Case(
        "tuned_absorber_with_an_inerter",
        # the inerter is an inertance of the relative speed
        """F Se effort: F
        v1 1
        m1 I flow: momentum/m1
        k1 C effort: k1*displacement
        z 0
        rel 1
        k2 C effort: k2*displacement
        b2 R effort: b2*flow
        B I flow: momentum/B
        v2 1
        m2 I flow: momentum/m2""",
        "F>v1 v1>m1 v1>k1 v1>z z>rel rel>k2 rel>b2 rel>B z>v2 v2>m2",
        # three inertances, two speeds: m1 and m2 are asked for, the inerter depends on both
        """a = momentum(m1)/m1
        b = momentum(m2)/m2
        f = k2*displacement(k2) + b2*(a - b)
        A = array([[m1 + B, -B], [-B, m2 + B]])
        r = solve(A, array([F - k1*displacement(k1) - f, f]))
        der momentum(m1) = m1*r[0]
        der momentum(m2) = m2*r[1]
        der displacement(k1) = a
        der displacement(k2) = a - b
        effort rel->B = B*(r[0] - r[1])""",
        "m1=10 k1=100 k2=20 b2=1 B=3 m2=2",
        "F",
    ),
    Case(
        "backlash_between_two_rotors",
        """T Se effort: T
        a 1
        Ja I flow: momentum/Ja
        z 0
        gap 1
        k C effort: k*(Max(displacement - d, 0) + Min(displacement + d, 0))
        b 1
        Jb I flow: momentum/Jb
        c R effort: c*flow + Tc*sign(flow)""",
        "T>a a>Ja a>z z>gap gap>k z>b b>Jb b>c",
        """x = displacement(k)
        f = k*(maximum(x - d, 0) + minimum(x + d, 0))
        w = momentum(Jb)/Jb
        der momentum(Ja) = T - f
        der momentum(Jb) = f - c*w - Tc*sign(w)
        der displacement(k) = momentum(Ja)/Ja - w""",
        "Ja=1 Jb=2 k=100 d=0.05 c=0.1 Tc=0.3",
        "T",
    ),
)

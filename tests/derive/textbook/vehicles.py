"""Machines that turn, drive and exchange matter: Karnopp et al. (2012), chapters 9 to 12; Krause (1986), chapter 4."""

from __future__ import annotations

from tests.derive.textbook.case import Case

CASES = (
    Case(
        "single_track_vehicle_in_its_own_axes",
        # Euler's junctions in the plane: the turning of the frame couples the two speeds by a gyrator of m r
        """x 1
        y 1
        r 1
        mx I flow: momentum/m
        my I flow: momentum/m
        J I flow: momentum/J
        G GY modulus: m*flow(r)
        push Se effort: F
        drag R effort: cd*flow*Abs(flow)
        front 0
        rear 0
        af TF modulus: a
        ar TF modulus: -b
        tf 1
        tr 1
        Cf R effort: kf*flow/v0
        Cr R effort: kr*flow/v0
        steer Sf flow: v0*delta""",
        # at the front the tyre slips with v + a r - v0 delta, at the rear with v - b r
        "x>mx y>my r>J push>x x>drag G>x y>G y>front r>af af>front front>tf tf>Cf front>steer y>rear r>ar ar>rear"
        " rear>tr tr>Cr",
        # af: flow_out = a r; G: effort_in = m r u on y, effort_out = m r v on x
        """u = momentum(mx)/m
        v = momentum(my)/m
        w = momentum(J)/J
        Ff = kf*(v + a*w - v0*delta)/v0
        Fr = kr*(v - b*w)/v0
        der momentum(mx) = F - cd*u*abs(u) + m*w*v
        der momentum(my) = -Ff - Fr - m*w*u
        der momentum(J) = -a*Ff + b*Fr
        flow tf->Cf = v + a*w - v0*delta""",
        "m=900 J=1200 a=1.1 b=1.4 kf=4e4 kr=5e4 cd=0.4 v0=20",
        "F delta",
        size={"momentum(mx)": 1e4, "momentum(my)": 900, "momentum(J)": 1200, "delta": 0.1, "F": 1e3},
    ),
    Case(
        "induction_machine_in_stator_axes",
        # fluxes of stator and rotor in two axes; the speed turns the rotor's fluxes by modulated gyrators
        """ua Se effort: u_a
        ub Se effort: u_b
        sa 1
        sb 1
        Rsa R effort: Rs*flow
        Rsb R effort: Rs*flow
        A I ports: 2; laws: ["(Lr*momentum1 - M*momentum2)/D", "(Ls*momentum2 - M*momentum1)/D"]
        B I ports: 2; laws: ["(Lr*momentum1 - M*momentum2)/D", "(Ls*momentum2 - M*momentum1)/D"]
        ra 1
        rb 1
        Rra R effort: Rr*flow
        Rrb R effort: Rr*flow
        Ga GY modulus: p*momentum2(B)
        Gb GY modulus: -p*momentum2(A)
        w 1
        J I flow: momentum/J
        load R effort: c*flow""",
        "ua>sa sa>Rsa sa>A ub>sb sb>Rsb sb>B ra>A rb>B ra>Rra rb>Rrb w>J w>load w>Ga Ga>ra w>Gb Gb>rb",
        # effort_out on the rotor = r w, effort_in on the shaft = r i
        """w = momentum(J)/J
        ia = (Lr*momentum1(A) - M*momentum2(A))/D
        ja = (Ls*momentum2(A) - M*momentum1(A))/D
        ib = (Lr*momentum1(B) - M*momentum2(B))/D
        jb = (Ls*momentum2(B) - M*momentum1(B))/D
        der momentum1(A) = u_a - Rs*ia
        der momentum1(B) = u_b - Rs*ib
        der momentum2(A) = -Rr*ja + p*momentum2(B)*w
        der momentum2(B) = -Rr*jb - p*momentum2(A)*w
        der momentum(J) = -c*w - p*momentum2(B)*ja + p*momentum2(A)*jb""",
        "Rs=0.5 Rr=0.4 Ls=0.1 Lr=0.11 M=0.09 D=0.0029 p=2 J=0.3 c=0.1",
        "u_a u_b",
    ),
    Case(
        "arm_of_two_links_with_motors_on_the_joints",
        # point masses at the ends, angles to the ground; the second motor turns the second link against the first
        """one 1
        two 1
        J1 I flow: momentum/J1
        J2 I flow: momentum/J2
        T1 Se effort: T1
        rel 1
        el 0
        T2 Se effort: T2
        b R effort: b*flow
        c1 TF modulus: -l1*sin(q1)
        s1 TF modulus: l1*cos(q1)
        c2 TF modulus: -l2*sin(q2)
        s2 TF modulus: l2*cos(q2)
        x1 1
        y1 1
        mx1 I flow: momentum/m1
        my1 I flow: momentum/m1
        zx 0
        zy 0
        x2 1
        y2 1
        mx2 I flow: momentum/m2
        my2 I flow: momentum/m2
        g1 Se effort: -m1*g
        g2 Se effort: -m2*g""",
        "T1>one one>J1 two>J2 T2>rel rel>el el>two one>el rel>b one>c1 c1>x1 one>s1 s1>y1"
        " x1>mx1 y1>my1 g1>y1 x1>zx y1>zy two>c2 c2>zx two>s2 s2>zy zx>x2 zy>y2 x2>mx2 y2>my2 g2>y2",
        # rel>el and one>el: the relative speed is that of two minus that of one
        """w1 = momentum(J1)/J1
        w2 = momentum(J2)/J2
        d = q1 - q2
        A = array([[J1 + (m1 + m2)*l1**2, m2*l1*l2*cos(d)], [m2*l1*l2*cos(d), J2 + m2*l2**2]])
        t2 = T2 - b*(w2 - w1)
        Q1 = T1 - t2 - (m1 + m2)*g*l1*cos(q1) - m2*l1*l2*sin(d)*w2**2
        Q2 = t2 - m2*g*l2*cos(q2) + m2*l1*l2*sin(d)*w1**2
        r = solve(A, array([Q1, Q2]))
        der momentum(J1) = J1*r[0]
        der momentum(J2) = J2*r[1]
        der q1 = w1
        der q2 = w2""",
        "J1=0.2 J2=0.1 m1=1 m2=0.7 l1=0.6 l2=0.5 g=9.81 b=0.3",
        "T1 T2",
        {"integrals": [{"name": "q1", "of": "flow(one)"}, {"name": "q2", "of": "flow(two)"}]},
    ),
    Case(
        "stirred_tank_with_heat_carried_by_the_flow",
        # pseudo-bonds: volume and heat as displacements, the heat that a flow carries by sources of its signal
        """feed Sf flow: Qin
        v 0
        V C effort: displacement/A
        valve R flow: K*sqrt(Abs(effort))*sign(effort)
        h 0
        H C effort: displacement/(rc*displacement(V))
        in Sf flow: rc*Qin*T_in
        out R flow: rc*flow(valve)*effort
        loss 1
        U R flow: U*effort
        amb Se effort: T_a
        heater Sf flow: P""",
        "feed>v v>V v>valve in>h heater>h h>H h>out h>loss loss>U loss>amb",
        """Q = K*sqrt(abs(displacement(V)/A))*sign(displacement(V))
        T = displacement(H)/(rc*displacement(V))
        der displacement(V) = Qin - Q
        der displacement(H) = rc*Qin*T_in + P - rc*Q*T - U*(T - T_a)
        effort h->out = T""",
        "A=2 K=0.3 rc=4 T_in=20 U=0.5 T_a=15",
        "Qin P",
        signed=False,
    ),
    Case(
        "predator_and_prey_as_reactions",
        """X 0
        Y 0
        CX C effort: displacement
        CY C effort: displacement
        birth R flow: -a*effort
        R R ports: 2; form: flow; laws: ["b*effort1*effort2", "-c*effort1*effort2"]
        death R flow: d*effort""",
        "X>CX Y>CY X>birth X>R Y>R Y>death",
        """x = displacement(CX)
        y = displacement(CY)
        der displacement(CX) = a*x - b*x*y
        der displacement(CY) = c*x*y - d*y""",
        "a=1 b=0.5 c=0.3 d=0.8",
        signed=False,
    ),
    Case(
        "line_of_twenty_sections_with_bonds_in_any_direction",
        "u Se effort: u\nload R effort: R*flow\n"
        + "\n".join(f"j{i} 1\nL{i} I flow: momentum/L\nz{i} 0\nC{i} C effort: displacement/C" for i in range(20)),
        # sections whose number is divisible by three point back to the source
        " ".join(
            f"{'u' if i == 0 else f'z{i - 1}'}>j{i} j{i}>L{i} z{i}>C{i} " + (f"j{i}>z{i}" if i % 3 else f"z{i}>j{i}")
            for i in range(20)
        )
        + " z19>load",
        # a section that points back sees the current and the voltage behind it with the opposite sign
        "\n".join(f"i{i} = momentum(L{i})/L\nv{i} = displacement(C{i})/C" for i in range(20))
        + "\n"
        + "\n".join(
            f"der momentum(L{i}) = {'u' if i == 0 else f'v{i - 1}'} {'-' if i % 3 else '+'} v{i}\n"
            f"der displacement(C{i}) = {'' if i % 3 else '-'}i{i} - {f'i{i + 1}' if i < 19 else 'v19/R'}"
            for i in range(20)
        ),
        "L=0.1 C=0.2 R=3",
        "u",
    ),
    Case(
        "four_bar_linkage",
        # three bars between two fixed points: a closed chain, two of the three angular speeds follow from the first
        """T Se effort: T
        w1 1
        w2 1
        w3 1
        J1 I flow: momentum/J1
        J2 I flow: momentum/J2
        J3 I flow: momentum/J3
        x 0
        y 0
        a1 TF modulus: -l1*sin(q1)
        a2 TF modulus: -l2*sin(q2)
        a3 TF modulus: l3*sin(q3)
        b1 TF modulus: l1*cos(q1)
        b2 TF modulus: l2*cos(q2)
        b3 TF modulus: -l3*cos(q3)
        b R effort: b*flow""",
        "T>w1 w1>J1 w2>J2 w3>J3 w3>b w1>a1 a1>x w2>a2 a2>x w3>a3 a3>x w1>b1 b1>y w2>b2 b2>y w3>b3 b3>y",
        # loop: sum of l_i e^{i q_i} w_i = 0: w2, w3 from w1
        """A = array([[-l2*sin(q2), l3*sin(q3)], [l2*cos(q2), -l3*cos(q3)]])
        c = array([-l1*sin(q1), l1*cos(q1)])
        w = momentum(J1)/J1
        k = solve(A, -c)
        w2 = k[0]*w
        w3 = k[1]*w
        dA = array([[-l2*cos(q2)*w2, l3*cos(q3)*w3], [-l2*sin(q2)*w2, l3*sin(q3)*w3]])
        dc = array([-l1*cos(q1)*w, -l1*sin(q1)*w])
        dk = solve(A, -dc - dA @ k)
        M = J1 + J2*k[0]**2 + J3*k[1]**2
        a = (T - b*k[1]*w3 - (J2*k[0]*dk[0] + J3*k[1]*dk[1])*w)/M
        der momentum(J1) = J1*a
        der q1 = w
        der q2 = w2
        der q3 = w3
        flow w2->J2 = w2
        effort w3->J3 = J3*(k[1]*a + dk[1]*w)""",
        "J1=0.2 J2=0.3 J3=0.4 l1=0.3 l2=0.8 l3=0.6 b=0.2",
        "T",
        {"integrals": [{"name": f"q{i}", "of": f"flow(w{i})"} for i in (1, 2, 3)]},
    ),
)

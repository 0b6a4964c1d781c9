"""Dependent storages, implicit laws and modulation: Borutzky (2010), chapter 4; Karnopp et al. (2012), chapter 7."""

from __future__ import annotations

from tests.derive.textbook.case import Case

CASES = (
    Case(
        "cubic_spring_under_a_given_force",
        # the inverse of the law has one real branch and no slope at zero
        """F Se effort: F
        z 0
        k C effort: a*displacement**3
        b R flow: effort/b""",
        "F>z z>k z>b",
        """q = sign(F)*(abs(F)/a)**(1/3)
        flow z->k = d_F/(3*a*q**2)
        flow F->z = d_F/(3*a*q**2) + F/b
        out q = q""",
        "a=2 b=3",
        "F",
        {"outputs": [{"name": "q", "variable": "displacement", "at": "k"}]},
        rates=("F",),
    ),
    Case(
        "rate_of_an_input_beside_a_parameter_of_its_name",
        """u Se effort: u
        z 0
        C C effort: displacement/C
        d_u R flow: effort/d_u""",
        "u>z z>C z>d_u",
        """flow u->z = C*rate_u + u/d_u""",
        "C=2 d_u=3",
        "u",
        rates=("u",),
    ),
    Case(
        "square_law_storages_in_parallel",
        """i Sf flow: i
        z 0
        C1 C effort: a*displacement*Abs(displacement)
        C2 C effort: b*displacement*Abs(displacement) + c*displacement""",
        "i>z z>C1 z>C2",
        """q = displacement(C1)
        e = a*q*abs(q)
        w = root(lambda x: b*x*abs(x) + c*x - e, -50.0, 50.0)
        s1 = 2*a*abs(q)
        s2 = 2*b*abs(w) + c
        der displacement(C1) = i/(1/s1 + 1/s2)/s1
        flow z->C2 = i/(1/s1 + 1/s2)/s2""",
        "a=1 b=2 c=0.5",
        "i",
    ),
    Case(
        "species_in_equilibrium_with_each_other",
        # two chemical capacities at one potential: the logarithm has no value at zero, where an iteration would start
        """s Sf flow: i
        z 0
        A C effort: RT*log(KA*displacement)
        B C effort: RT*log(KB*displacement) + c*displacement""",
        "s>z z>A z>B",
        """a = displacement(A)
        e = RT*log(KA*a)
        b = root(lambda x: RT*log(KB*x) + c*x - e, 1e-30, 100.0)
        sa = RT/a
        sb = RT/b + c
        der displacement(A) = i/(1/sa + 1/sb)/sa
        flow z->B = i/(1/sa + 1/sb)/sb""",
        "RT=2.5 KA=1 KB=3 c=0.2",
        "i",
        signed=False,
    ),
    Case(
        "two_bodies_at_one_temperature",
        """h Se effort: T_h
        j 1
        G R flow: effort/R
        z 0
        A C effort: T0*exp(displacement/a)
        B C effort: T0*exp(displacement/b)""",
        "h>j j>G j>z z>A z>B",
        # equal temperatures: S_B/b = S_A/a, so that the rates are as a to b
        """T = T0*exp(displacement(A)/a)
        S = (T_h - T)/R
        der displacement(A) = S*a/(a + b)
        flow z->B = S*b/(a + b)""",
        "T0=300 a=2 b=3 R=0.5",
        "T_h",
    ),
    Case(
        "mass_behind_a_gear_whose_ratio_is_an_input",
        # v2 = u v1; the momentum of the second mass changes with the ratio too
        """F Se effort: F
        a 1
        m1 I flow: momentum/m1
        T TF modulus: u
        b 1
        m2 I flow: momentum/m2
        d R effort: d*flow""",
        "F>a a>m1 a>T T>b b>m2 b>d",
        """v = momentum(m1)/m1
        dv = (F - u*(m2*d_u*v + d*u*v))/(m1 + u**2*m2)
        der momentum(m1) = m1*dv
        effort b->m2 = m2*(u*dv + d_u*v)""",
        "m1=2 m2=3 d=0.4",
        "F u",
        rates=("u",),
    ),
    Case(
        "mass_behind_a_gear_whose_ratio_follows_time_and_the_other_side",
        """a 1
        m1 I flow: momentum/m1
        T TF modulus: 1 + 0.3*sin(w*t) + 0.1*displacement(k)
        b 1
        m2 I flow: momentum/m2
        k C effort: k*displacement""",
        "a>m1 a>T T>b b>m2 b>k",
        """n = 1 + 0.3*sin(w*t) + 0.1*displacement(k)
        v = momentum(m1)/m1
        dn = 0.3*w*cos(w*t) + 0.1*n*v
        dv = -n*(m2*dn*v + k*displacement(k))/(m1 + n**2*m2)
        der momentum(m1) = m1*dv
        der displacement(k) = n*v""",
        "m1=2 m2=3 k=5 w=2",
    ),
    Case(
        "gyrator_modulated_by_the_flow_it_makes",
        # r = K f2: e1 = K f2^2, e2 = K f2 f1 balances R f2: f2 (K f1 - R) = -E: a loop through the modulus
        """u Sf flow: u
        a 1
        L R effort: b*flow
        G GY modulus: K*flow(w)
        w 1
        R R effort: R*flow
        E Se effort: E""",
        "u>a a>L a>G G>w E>w w>R",
        """f = E/(R - K*u)
        effort u->a = b*u + K*f**2
        flow w->R = f""",
        "b=1 K=0.3 R=4 E=2",
        "u",
    ),
    Case(
        "resistance_modulated_by_the_effort_beside_it",
        """i Sf flow: i
        z 0
        C C effort: displacement/C
        j 1
        r R effort: (r + a*effort(z)**2)*flow
        L I flow: momentum/L""",
        "i>z z>C z>j j>r j>L",
        """v = displacement(C)/C
        f = momentum(L)/L
        der displacement(C) = i - f
        der momentum(L) = v - (r + a*v**2)*f""",
        "C=0.5 L=2 r=1 a=0.3",
        "i",
    ),
    Case(
        "controlled_source_around_a_resistor_loop",
        # a transconductance amplifier with feedback: linear loop through signals
        """u Se effort: u
        j 1
        Rs R effort: Rs*flow
        in 0
        Ri R flow: effort/Ri
        f 1
        Rf R effort: Rf*flow
        out 0
        gm Sf flow: -g*effort(in)
        Rl R flow: effort/Rl
        Cl C effort: displacement/Cl
        x 1
        Rx R effort: Rx*flow""",
        "u>j j>Rs j>in in>Ri in>f f>Rf f>out gm>out out>Rl out>x x>Rx x>Cl",
        """vc = displacement(Cl)/Cl
        A = array([[1/Rs + 1/Ri + 1/Rf, -1/Rf], [-1/Rf + g, 1/Rf + 1/Rl + 1/Rx]])
        v = solve(A, array([u/Rs, vc/Rx]))
        der displacement(Cl) = (v[1] - vc)/Rx
        effort in->Ri = v[0]
        effort out->Rl = v[1]""",
        "Rs=50 Ri=1e3 Rf=2e3 g=0.1 Rl=500 Cl=1e-6 Rx=10",
        "u",
        size={"displacement(Cl)": 1e-6},
    ),
    Case(
        "instrumentation_amplifier_of_three_ideal_amplifiers",
        """ua Se effort: u_a
        ub Se effort: u_b
        pa 0
        pb 0
        na 0
        nb 0
        oa 0
        ob 0
        g 1
        Rg R effort: Rg*flow
        ra 1
        Ra R effort: R1*flow
        rb 1
        Rb R effort: R1*flow
        da 1
        db 1
        A R ports: 2; residuals: ["effort1", "flow1"]
        B R ports: 2; residuals: ["effort1", "flow1"]
        s1 1
        R2 R effort: R2*flow
        s2 1
        R3 R effort: R3*flow
        m 0
        p 0
        dm 1
        C R ports: 2; residuals: ["effort1", "flow1"]
        out 0
        t2 1
        R4 R effort: R2*flow
        t3 1
        R5 R effort: R3*flow
        ground Se effort: 0
        load R flow: effort/Rl""",
        "ua>pa pa>da da>na da>A oa>ra ra>Ra ra>na na>g g>Rg g>nb nb>rb rb>Rb rb>ob ub>pb pb>db db>nb db>B oa>A ob>B"
        " oa>s1 s1>R2 s1>m m>s2 s2>R3 s2>out ob>t2 t2>R4 t2>p p>t3 t3>R5 ground>t3 p>dm dm>m dm>C out>C out>load",
        # the two first stages: out_a - out_b = (1 + 2 R1/Rg)(u_a - u_b); the third takes R3/R2 of the difference
        """y = -(R3/R2)*(1 + 2*R1/Rg)*(u_a - u_b)
        effort out->load = y""",
        "Rg=100 R1=1000 R2=2000 R3=6000 Rl=500",
        "u_a u_b",
    ),
    Case(
        "integral_of_an_input_and_of_a_product",
        """F Se effort: F - k*area
        v 1
        m I flow: momentum/m""",
        "F>v v>m",
        """der momentum(m) = F - k*area
        der area = u*momentum(m)/m + F
        der twice = area""",
        "m=2 k=0.3",
        "F u",
        {"integrals": [{"name": "area", "of": "u*flow(v) + F"}, {"name": "twice", "of": "area"}]},
    ),
    Case(
        "three_port_fields_of_each_kind",
        """a 1
        b 1
        c 1
        K C ports: 3; energy: k*(displacement1 + displacement2 - displacement3)**2/2 \
        + h*displacement1**2*displacement2**2
        M I ports: 3; laws: ["a11*momentum1", "a11*momentum2 + a12*momentum3", "a12*momentum2 + 2*momentum3"]
        B R ports: 3; laws: ["r*(flow1 - flow2)", "r*(flow2 - flow1) + s*flow3**3", "flow3 + s*flow2"]
        F Se effort: F""",
        "a>K b>K c>K a>M b>M c>M a>B b>B c>B F>b",
        """p1 = momentum1(M)
        p2 = momentum2(M)
        p3 = momentum3(M)
        v1 = a11*p1
        v2 = a11*p2 + a12*p3
        v3 = a12*p2 + 2*p3
        q1 = displacement1(K)
        q2 = displacement2(K)
        s_ = q1 + q2 - displacement3(K)
        der momentum1(M) = -k*s_ - 2*h*q1*q2**2 - r*(v1 - v2)
        der momentum2(M) = F - k*s_ - 2*h*q1**2*q2 - r*(v2 - v1) - s*v3**3
        der momentum3(M) = k*s_ - v3 - s*v2
        der displacement1(K) = v1
        der displacement2(K) = v2
        der displacement3(K) = v3""",
        "k=3 h=0.2 a11=1.5 a12=0.4 r=0.6 s=0.1",
        "F",
    ),
    Case(
        "dependent_port_of_a_nonlinear_field",
        # one port of a nonlinear inductor pair carries a given current: its flux follows, and its voltage from its rate
        """u Se effort: u
        a 1
        R R effort: R*flow
        L I ports: 2; energy: (momentum1**2 + momentum2**2)/(2*L) + h*(momentum1 - momentum2)**4/4
        i Sf flow: i
        b 1""",
        "u>a a>R a>L i>b b>L",
        """p = momentum1(L)
        q = root(lambda q: q/L - h*(p - q)**3 - i, -50.0, 50.0)
        f = p/L + h*(p - q)**3
        dp = u - R*f
        s = 3*h*(p - q)**2
        dq = (d_i + s*dp)/(1/L + s)
        der momentum1(L) = dp
        effort b->L = dq""",
        "R=2 L=1.5 h=0.4",
        "u i",
        rates=("i",),
    ),
)

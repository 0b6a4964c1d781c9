"""Design of experiments: what planned manoeuvres would tell of parameters, and which tells rival models apart."""

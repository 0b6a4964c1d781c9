"""Vehicles and effects declared as bond graphs."""

#: Graphs whose modules are kept in ``generated/``.
GENERATED = (
    "vehicle_graphs.driveline:driveline",
    "vehicle_graphs.baja:launch",
    "vehicle_graphs.baja:launch_given_engine",
    "vehicle_graphs.ranger:full",
    "vehicle_graphs.ranger:full_awd",
    "vehicle_graphs.ranger:coast_down",
    "vehicle_graphs.ranger:coast_down_quasi_static",
)

"""Programs made from programs: derivatives, factors, parts that do not change."""

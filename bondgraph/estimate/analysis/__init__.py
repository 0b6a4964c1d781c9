"""What logs say about parameters before anything is estimated: curvature, combinations, ranking, screening, rates."""

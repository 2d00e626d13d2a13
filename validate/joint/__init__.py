"""All parameters together: regions, projections and quantities of them, and the densities of draws."""

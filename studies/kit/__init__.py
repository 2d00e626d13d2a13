"""What all studies share: results with their provenance, work that resumes, figures, pages, commands."""

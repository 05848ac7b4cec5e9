"""Show and use datasets: browse page, live view, card, pictures, physics check, learning."""

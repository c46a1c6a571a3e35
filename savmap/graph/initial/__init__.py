"""Where the solve starts: linear equations, what the references leave open of scale and place, outliers among them."""

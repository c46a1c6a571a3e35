"""What a mapped rack looks like beside a survey: scores and figures."""

"""Pages, pictures and recordings: edges, which nothing else imports but the figures."""

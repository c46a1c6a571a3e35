"""`savmap adapt`: a site's map labels its own footage, and the network learns from that. See docs/adapting.md."""

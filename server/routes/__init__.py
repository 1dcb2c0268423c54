"""REST resources: one file each, thin over the services."""

"""What systems are made of. Each part declares what it reports beside the code that reports it."""

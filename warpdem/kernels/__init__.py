"""Device code: what happens to one element or one bond. Imports only warp and itself."""

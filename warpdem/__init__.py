"""warpdem: fracture of solids made of bonded elements, on NVIDIA Warp."""

"""The simulated world: cloth, muscles, two arms, the camera\x27s mask, and a Gymnasium environment of them."""

"""The method: autoencoder, DPMPB and its training, online estimation of p, and control
by gradient.
"""

"""Units: the folder of one episode, which datasets are made of."""

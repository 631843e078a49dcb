"""The paper's equations, symbolically, and the data they need along the arc length; knows no solver."""

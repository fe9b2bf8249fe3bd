"""The least-squares adjustment of the arm's parameters."""

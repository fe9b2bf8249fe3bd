"""The least-squares adjustment of an arm's parameters: problem, solution, tests."""

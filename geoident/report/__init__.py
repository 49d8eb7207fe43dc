"""Results for people and for other programs: nothing here knows how they were found.

What is said stands once, in `text`: sentences, `TextTable`s, numbers in the user's units; for a
terminal as it is, for the page as HTML (`page`). `drawing` has the figures. Who looks for a topic
finds it under the same name: `case`, `parameters`, `gauges`, `yielding`, `structures`, `result`.
"""

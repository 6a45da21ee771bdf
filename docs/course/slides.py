"""Settings of nbconvert for slides: headings begin slides, code is left out."""

from nbconvert.preprocessors import Preprocessor


class Headings(Preprocessor):
    """Begins a slide at each heading; below it, each figure has a page of its own."""

    def preprocess_cell(self, cell, resources, index):
        """Set the type of a cell's slide, where the notebook names none."""
        pictures = [
            output
            for output in cell.get("outputs", [])
            if {"image/png", "image/svg+xml"} & set(output.get("data", {}))
        ]
        kind = "subslide" if pictures else "-"
        if cell.cell_type == "markdown" and cell.source.startswith("#"):
            kind = "slide"
        cell.metadata.setdefault("slideshow", {}).setdefault("slide_type", kind)
        return cell, resources


c = get_config()  # noqa: F821  (nbconvert provides it)
c.SlidesExporter.preprocessors = [Headings]
c.SlidesExporter.reveal_scroll = True  # what is longer than a slide scrolls
c.SlidesExporter.embed_images = True
c.SlidesExporter.exclude_input = True
c.TagRemovePreprocessor.enabled = True
c.TagRemovePreprocessor.remove_cell_tags = {"claim", "colab", "solution", "stub"}

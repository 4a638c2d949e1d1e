//! Objects with their pictures.

use base64::{Engine as _, engine::general_purpose::STANDARD};
use charts::escaped;

use crate::{
    pictures::SIZE,
    table::{Picture, Tile},
};

/// A list of objects, each with its pictures side by side and lines about it; a click on its name shows its motions.
pub(super) fn tiles(tiles: &[Tile]) -> String {
    if tiles.is_empty() {
        return String::new();
    }
    let mut text = String::from("<ul class=\"tiles\">\n");
    for tile in tiles {
        let object = escaped(&tile.object);
        let pictures: String = tile.pictures.iter().map(picture).collect();
        let lines = tile.lines.iter();
        let lines: Vec<String> = lines
            .map(|line| format!("<p>{}</p>\n", escaped(line)))
            .collect();
        let lines = lines.concat();
        let heading = if tile.has_motion {
            format!(
                "<button type=\"button\" class=\"link\" data-filter=\"object\" data-value=\"{object}\">{object}</button>"
            )
        } else {
            object
        };
        text.push_str(&format!(
            "<li>\n<h3>{heading}</h3>\n<div class=\"pictures\">\n{pictures}</div>\n{lines}</li>\n"
        ));
    }
    text.push_str("</ul>\n");
    text
}

fn picture(picture: &Picture) -> String {
    let [width, height] = SIZE;
    format!(
        "<figure><img src=\"data:image/png;base64,{}\" width=\"{width}\" height=\"{height}\" alt=\"{}\">\
         <figcaption>{}</figcaption></figure>\n",
        STANDARD.encode(&picture.png),
        escaped(&picture.about),
        escaped(picture.caption)
    )
}

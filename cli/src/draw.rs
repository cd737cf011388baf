//! Pictures of lines, marks and text, as SVG and PNG.

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Of words and frames.
pub const BLACK: Colour = [34, 34, 34];
/// Of words beside.
pub const GREY: Colour = [120, 120, 120];
/// Of lines behind what is shown.
pub const PALE: Colour = [226, 226, 226];
/// Told apart also by those who see colours otherwise, together with marks.
pub const COLOURS: [Colour; 10] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [150, 80, 160],
    [86, 150, 220],
    [160, 110, 0],
    [190, 30, 60],
    [90, 90, 90],
    [70, 130, 30],
    [220, 120, 170],
];

/// Where a text has its place.
#[derive(Clone, Copy)]
pub enum Anchor {
    /// At its start.
    Start,
    /// In its middle.
    Middle,
    /// At its end.
    End,
}

/// The shape of a mark.
#[derive(Clone, Copy)]
pub enum Mark {
    /// A circle.
    Circle,
    /// A square.
    Square,
    /// A triangle that stands.
    Triangle,
    /// A square on its corner.
    Diamond,
}

/// A format of pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PictureFormat {
    /// Lines as text.
    Svg,
    /// Points.
    Png,
}

/// 10 to a power, as one writes it.
pub fn power(k: i32) -> String {
    let digits = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let small = k.to_string().chars().map(|c| c.to_digit(10).map_or('⁻', |d| digits[d as usize])).collect::<String>();
    match k {
        0 => "1".into(),
        1 => "10".into(),
        _ => format!("10{small}"),
    }
}

/// What is drawn, in order. Lengths are in points of the picture, from its upper left corner.
pub struct Drawing {
    size: (f64, f64),
    list: Vec<Shape>,
}

enum Shape {
    Line { points: Vec<(f64, f64)>, colour: Colour, width: f64, dashes: Option<&'static str> },
    Rect { at: (f64, f64), size: (f64, f64), colour: Colour },
    Area { points: Vec<(f64, f64)>, colour: Colour, full: bool },
    Circle { at: (f64, f64), radius: f64, colour: Colour, full: bool },
    Text { at: (f64, f64), text: String, size: u32, colour: Colour, middle: Anchor, up: bool },
}

impl Drawing {
    /// An empty one.
    pub fn new(width: f64, height: f64) -> Self {
        Self { size: (width, height), list: Vec::new() }
    }

    /// A line through points; dashes as in SVG.
    pub fn line(&mut self, points: &[(f64, f64)], colour: Colour, width: f64, dashes: Option<&'static str>) {
        if points.len() > 1 {
            self.list.push(Shape::Line { points: points.to_vec(), colour, width, dashes });
        }
    }

    /// A filled rectangle.
    pub fn rect(&mut self, at: (f64, f64), size: (f64, f64), colour: Colour) {
        self.list.push(Shape::Rect { at, size, colour });
    }

    /// A mark, filled or open.
    pub fn mark(&mut self, mark: Mark, at: (f64, f64), radius: f64, colour: Colour, full: bool) {
        let corners: &[(f64, f64)] = match mark {
            Mark::Circle => {
                self.list.push(Shape::Circle { at, radius, colour, full });
                return;
            }
            Mark::Square => &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
            Mark::Triangle => &[(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)],
            Mark::Diamond => &[(0.0, -1.25), (1.25, 0.0), (0.0, 1.25), (-1.25, 0.0)],
        };
        let points = corners.iter().map(|(x, y)| (at.0 + radius * x, at.1 + radius * y)).collect();
        self.list.push(Shape::Area { points, colour, full });
    }

    /// A text on its line.
    pub fn text(&mut self, at: (f64, f64), text: &str, size: u32, colour: Colour, middle: Anchor) {
        self.list.push(Shape::Text { at, text: text.into(), size, colour, middle, up: false });
    }

    /// A text that runs upwards.
    pub fn text_up(&mut self, at: (f64, f64), text: &str, size: u32, colour: Colour, middle: Anchor) {
        self.list.push(Shape::Text { at, text: text.into(), size, colour, middle, up: true });
    }

    /// Its bytes, the same on every machine.
    ///
    /// # Errors
    /// What cannot be drawn, in words.
    #[cfg(not(feature = "plot"))]
    pub fn bytes(&self, _: PictureFormat) -> Result<Vec<u8>, String> {
        let _ = (&self.size, &self.list);
        Err("pictures are not part of this program".into())
    }

    /// Its bytes, the same on every machine.
    ///
    /// # Errors
    /// What cannot be drawn, in words.
    #[cfg(feature = "plot")]
    pub fn bytes(&self, format: PictureFormat) -> Result<Vec<u8>, String> {
        use kuva::backend::{raster::RasterBackend, svg::SvgBackend};
        let mut scene = kuva::render::render::Scene::new(self.size.0, self.size.1);
        scene.font_family = Some("DejaVu Sans, Verdana, sans-serif".into());
        scene.elements = self.list.iter().map(Shape::primitive).collect();
        match format {
            PictureFormat::Svg => Ok(SvgBackend::default().render_scene(&scene).into_bytes()),
            PictureFormat::Png => RasterBackend::new().with_scale(2.0).render_scene(&scene),
        }
    }
}

#[cfg(feature = "plot")]
impl Shape {
    fn primitive(&self) -> kuva::render::render::Primitive {
        use kuva::render::color::Color;
        use kuva::render::render::{PathData, Primitive, TextAnchor};
        use std::fmt::Write;
        let paint = |c: &Colour| Color::Rgb(c[0], c[1], c[2]);
        let inside = |c: &Colour, full: bool| if full { paint(c) } else { Color::Rgb(255, 255, 255) };
        match self {
            Shape::Line { points, colour, width, dashes } => Primitive::PolyLine {
                points: points.clone(),
                stroke: paint(colour),
                stroke_width: *width,
                stroke_dasharray: dashes.map(String::from),
            },
            Shape::Rect { at, size, colour } => Primitive::Rect {
                x: at.0,
                y: at.1,
                width: size.0,
                height: size.1,
                fill: paint(colour),
                stroke: None,
                stroke_width: None,
                opacity: None,
            },
            Shape::Area { points, colour, full } => {
                let mut d = String::new();
                for (i, (x, y)) in points.iter().enumerate() {
                    // Writing to a string cannot fail.
                    let _ = write!(d, "{}{x:.2},{y:.2} ", if i == 0 { 'M' } else { 'L' });
                }
                Primitive::Path(Box::new(PathData {
                    d: d + "Z",
                    fill: Some(inside(colour, *full)),
                    stroke: paint(colour),
                    stroke_width: 1.3,
                    opacity: None,
                    stroke_dasharray: None,
                }))
            }
            Shape::Circle { at, radius, colour, full } => Primitive::Circle {
                cx: at.0,
                cy: at.1,
                r: *radius,
                fill: inside(colour, *full),
                fill_opacity: None,
                stroke: Some(paint(colour)),
                stroke_width: Some(1.3),
            },
            Shape::Text { at, text, size, colour, middle, up } => Primitive::Text {
                x: at.0,
                y: at.1,
                content: text.clone(),
                size: *size,
                anchor: match middle {
                    Anchor::Start => TextAnchor::Start,
                    Anchor::Middle => TextAnchor::Middle,
                    Anchor::End => TextAnchor::End,
                },
                rotate: up.then_some(-90.0),
                bold: false,
                color: Some(paint(colour)),
            },
        }
    }
}

//! The parts a page is made of.
//!
//! A [`Page`] is plain data: sections of [`PageBlock`]s, and [`Selector`]s that a reader works. Anything that
//! shows only for some choice (a series for one record at one step of a model's growth) carries [`When`]
//! conditions; the script in the page shows what matches the present choice and hides the rest. Nothing here
//! knows about files or HTML: `encode` turns numbers into compact columns and `html` turns the whole into one
//! file.

use serde::Serialize;

/// One self-contained page.
#[derive(Clone, Debug, Default)]
pub struct Page {
    /// Title of the window and of the page.
    pub title: String,
    /// One sentence in plain words: what the reader should take home.
    pub lead_sentence: String,
    /// How that sentence is to be taken; sets the colour beside it.
    pub tone: Tone,
    /// Short facts under the sentence, such as the data set and the noise floor.
    pub facts: Vec<(String, String)>,
    /// Choices offered in the bar at the top; every plot follows them.
    pub selectors: Vec<Selector>,
    /// The sections in reading order.
    pub sections: Vec<Section>,
    /// Small print: program version, the command that made the page.
    pub footer: Vec<String>,
}

/// How a message is meant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// Neither good nor bad.
    #[default]
    Neutral,
    /// Everything is explained, a goal is met.
    Good,
    /// Something needs the reader's attention.
    Attention,
}

/// A heading with explanatory text and blocks.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// Heading.
    pub heading: String,
    /// Text under the heading; empty lines separate paragraphs.
    pub text: String,
    /// Plots, tables and the like, in reading order.
    pub blocks: Vec<PageBlock>,
}

/// Anything that stands in a section.
#[derive(Clone, Debug)]
pub enum PageBlock {
    /// Curves over an axis.
    Plot(Plot),
    /// Rows of text and numbers.
    Table(Table),
    /// The error falling step by step.
    Waterfall(Waterfall),
    /// Coloured cells, for instance records x drive features.
    HeatMap(HeatMap),
    /// Remarks as a list.
    Notes(Notes),
}

/// A choice that the reader makes.
#[derive(Clone, Debug, Serialize)]
pub struct Selector {
    /// Name that [`When`] refers to.
    pub id: String,
    /// Label shown before the options.
    pub label: String,
    /// The options, in order.
    pub options: Vec<String>,
    /// Index of the option shown first.
    pub selected: usize,
    /// The options are successive steps of one thing: offers "previous" and "next", and "keep scales" holds
    /// the axes over them.
    pub steps: bool,
}

/// Shown only while `selector` stands at `option`.
#[derive(Clone, Debug, Serialize, PartialEq, Eq)]
pub struct When(
    /// [`Selector::id`].
    pub String,
    /// Index into [`Selector::options`].
    pub usize,
);

/// Share of the page's width.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Width {
    /// The whole width.
    Full,
    /// Two side by side.
    #[default]
    Half,
    /// Three side by side.
    Third,
}

/// One axis.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Axis {
    /// What is drawn along it.
    pub label: String,
    /// Its unit; empty for a pure number.
    pub unit: String,
    /// Logarithmic: values at or below zero are left out.
    pub log: bool,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Style {
    /// Joined points.
    #[default]
    Line,
    /// Joined, dashed.
    Dashed,
    /// Separate dots.
    Points,
    /// Held from one sample to the next.
    Steps,
}

/// What a series stands for; the page gives each role its colour, the same in every plot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CurveRole {
    /// What was measured.
    #[default]
    Measured,
    /// What a model says.
    Model,
    /// Measured minus modelled.
    Residual,
    /// Drive of the actuator.
    Drive,
    /// What was asked for.
    Reference,
    /// One of several of the same kind.
    Other1,
    /// A second of several.
    Other2,
    /// A third of several.
    Other3,
    /// A fourth of several.
    Other4,
}

/// One curve.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Name in the legend; series with the same name share one legend entry.
    pub label: String,
    /// Abscissae, in the unit of the plot's x axis.
    pub x: Vec<f64>,
    /// Ordinates, in the unit of the plot's y axis; anything not finite is a gap.
    pub y: Vec<f64>,
    /// How it is drawn.
    pub style: Style,
    /// What it stands for.
    pub role: CurveRole,
    /// Shown only under these conditions.
    pub when: Vec<When>,
}

impl Series {
    /// A line through the points (x, y).
    pub fn line(label: impl Into<String>, role: CurveRole, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self {
            label: label.into(),
            x,
            y,
            role,
            ..Self::default()
        }
    }

    /// Separate dots at (x, y).
    pub fn points(label: impl Into<String>, role: CurveRole, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self {
            style: Style::Points,
            ..Self::line(label, role, x, y)
        }
    }

    /// The same in another style.
    pub fn style(mut self, style: Style) -> Self {
        self.style = style;
        self
    }

    /// The same, shown only while `selector` stands at `option`.
    pub fn when(mut self, selector: &str, option: usize) -> Self {
        self.when.push(When(selector.to_owned(), option));
        self
    }
}

/// A horizontal line with a name, such as a noise floor.
#[derive(Clone, Debug, Serialize)]
pub struct Level {
    /// Name beside the line.
    pub label: String,
    /// Ordinate.
    pub value: f64,
    /// Shown only under these conditions.
    pub when: Vec<When>,
}

/// A shaded stretch of an axis.
#[derive(Clone, Debug, Serialize)]
pub struct Band {
    /// Name beside it.
    pub label: String,
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
    /// Along x (a stretch of time) or along y (a range of values).
    pub along_x: bool,
    /// Shown only under these conditions.
    pub when: Vec<When>,
}

/// Curves over an axis. Dragging zooms, a double click resets, plots with the same `link` share their x axis.
#[derive(Clone, Debug, Default)]
pub struct Plot {
    /// Title.
    pub title: String,
    /// What to see in it.
    pub caption: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Curves.
    pub series: Vec<Series>,
    /// Horizontal lines.
    pub levels: Vec<Level>,
    /// Shaded stretches.
    pub bands: Vec<Band>,
    /// Plots with the same name here share their x axis and cursor.
    pub link: Option<String>,
    /// Share of the page's width.
    pub width: Width,
    /// Height of the drawing in px; 0 takes the default.
    pub height_px: u32,
    /// Both axes have the same scale.
    pub equal: bool,
    /// The vertical axis ends at percentiles where a few values would blow it up; a button shows the whole.
    pub percentiles: bool,
}

impl Plot {
    /// An empty plot with a title.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            ..Self::default()
        }
    }

    /// Names the horizontal axis.
    pub fn x_axis(mut self, label: &str, unit: &str) -> Self {
        self.x = Axis {
            label: label.to_owned(),
            unit: unit.to_owned(),
            log: self.x.log,
        };
        self
    }

    /// Names the vertical axis.
    pub fn y_axis(mut self, label: &str, unit: &str) -> Self {
        self.y = Axis {
            label: label.to_owned(),
            unit: unit.to_owned(),
            log: self.y.log,
        };
        self
    }

    /// Makes the axes logarithmic.
    pub fn log(mut self, x: bool, y: bool) -> Self {
        self.x.log = x;
        self.y.log = y;
        self
    }

    /// Adds a curve.
    pub fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// Adds a named horizontal line.
    pub fn level(mut self, label: &str, value: f64) -> Self {
        self.levels.push(Level {
            label: label.to_owned(),
            value,
            when: Vec::new(),
        });
        self
    }

    /// Says what to see in the plot.
    pub fn caption(mut self, caption: impl Into<String>) -> Self {
        self.caption = caption.into();
        self
    }

    /// Shares the x axis with the plots of the same name.
    pub fn link(mut self, name: &str) -> Self {
        self.link = Some(name.to_owned());
        self
    }

    /// Sets the share of the page's width.
    pub fn width(mut self, width: Width) -> Self {
        self.width = width;
        self
    }

    /// Gives both axes the same scale.
    pub fn equal(mut self) -> Self {
        self.equal = true;
        self
    }

    /// Lets the vertical axis end at percentiles where a few values would blow it up.
    pub fn percentiles(mut self) -> Self {
        self.percentiles = true;
        self
    }

    /// Sets the height of the drawing in px.
    pub fn height_px(mut self, height_px: u32) -> Self {
        self.height_px = height_px;
        self
    }
}

/// Rows of text and numbers. Cells are text, already rounded as they should read; cells that look like
/// numbers are aligned as such.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Title above the table; may be empty.
    pub title: String,
    /// Column headings.
    pub columns: Vec<String>,
    /// Rows; a short one is filled up with empty cells.
    pub rows: Vec<Vec<String>>,
    /// Rows (by index) to set off, for instance the named effect.
    pub highlighted_rows: Vec<usize>,
    /// Remark below the table.
    pub caption: String,
}

/// One column of a [`Waterfall`].
#[derive(Clone, Debug, Serialize)]
pub struct WaterfallStep {
    /// Name, for instance the added effect.
    pub label: String,
    /// Value to be compared with the one before (validation).
    pub value: f64,
    /// A second value beside it (identification), if there is one.
    pub beside: Option<f64>,
}

/// The error falling step by step down to a floor, on a logarithmic scale.
#[derive(Clone, Debug)]
pub struct Waterfall {
    /// Title.
    pub title: String,
    /// What to see in it.
    pub caption: String,
    /// The steps in order.
    pub steps: Vec<WaterfallStep>,
    /// Names of the main value and of the one beside it.
    pub value_labels: (String, String),
    /// Level that cannot be passed, with its name.
    pub floor: Option<(String, f64)>,
    /// Unit of all values.
    pub unit: String,
    /// A click on a step sets this selector to its index.
    pub selector: Option<String>,
}

/// Values of a [`HeatMap`] under a condition.
#[derive(Clone, Debug, Serialize)]
pub struct HeatMapLayer {
    /// Row by row; None where there is no data.
    pub values: Vec<Vec<Option<f64>>>,
    /// Shown only under these conditions.
    pub when: Vec<When>,
}

/// Coloured cells with their numbers.
#[derive(Clone, Debug)]
pub struct HeatMap {
    /// Title.
    pub title: String,
    /// What to see in it.
    pub caption: String,
    /// Row names.
    pub rows: Vec<String>,
    /// Column names under their group headings: (group, columns).
    pub column_groups: Vec<(String, Vec<String>)>,
    /// Values; the first layer whose conditions hold is shown.
    pub layers: Vec<HeatMapLayer>,
    /// Value that gets no colour (such as 1 x the noise floor); colour grows with the logarithm above it.
    /// Without it, the smallest value gets none.
    pub neutral: Option<f64>,
    /// Unit of the values.
    pub unit: String,
    /// A click on a row sets this selector to its index.
    pub selector: Option<String>,
}

/// Remarks as a list.
#[derive(Clone, Debug, Default)]
pub struct Notes {
    /// Title; may be empty.
    pub title: String,
    /// The remarks.
    pub items: Vec<String>,
    /// How they are meant.
    pub tone: Tone,
}

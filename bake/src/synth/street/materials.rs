//! What the street is made of.

use squall_scene::Material;
use squall_scene::write::GlbWriter;

/// A material by name. Shading adds its pattern by the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stuff {
    Asphalt,
    Paint,
    Iron,
    Kerb,
    Slab,
    Brick,
    BrickDark,
    Plaster,
    PlasterBlue,
    Stone,
    Frame,
    FrameDark,
    Glass,
    PaneDark,
    PaneWarm,
    PaneCool,
    PaneDim,
    ShopGlass,
    ShopWall,
    ShopFloor,
    ShopLight,
    GoodsRed,
    GoodsGreen,
    GoodsYellow,
    GoodsBlue,
    AwningRed,
    AwningWhite,
    AwningGreen,
    Steel,
    SteelDark,
    LampGlow,
    NeonPink,
    NeonCyan,
    NeonAmber,
    SignGreen,
    SignRed,
    SignalRed,
    SignalOff,
    CarPaint,
    CarGlass,
    Rubber,
    Chrome,
    TailLight,
    HeadLight,
    Roof,
    Plastic,
}

/// Share of light at each colour, emission in W/(m² sr), roughness and metal.
type Row = (Stuff, &'static str, [f32; 3], [f32; 3], f32, f32);

const NONE: [f32; 3] = [0.0; 3];

#[rustfmt::skip]
const ROWS: [Row; 46] = [
    (Stuff::Asphalt, "asphalt", [0.085, 0.085, 0.09], NONE, 0.9, 0.0),
    (Stuff::Paint, "road paint", [0.55, 0.54, 0.5], NONE, 0.7, 0.0),
    (Stuff::Iron, "cast iron", [0.11, 0.1, 0.095], NONE, 0.45, 0.6),
    (Stuff::Kerb, "granite kerb", [0.33, 0.32, 0.31], NONE, 0.7, 0.0),
    (Stuff::Slab, "concrete slabs", [0.27, 0.26, 0.25], NONE, 0.85, 0.0),
    (Stuff::Brick, "brick", [0.32, 0.14, 0.09], NONE, 0.9, 0.0),
    (Stuff::BrickDark, "brick dark", [0.17, 0.1, 0.085], NONE, 0.9, 0.0),
    (Stuff::Plaster, "plaster", [0.5, 0.45, 0.36], NONE, 0.9, 0.0),
    (Stuff::PlasterBlue, "plaster grey", [0.3, 0.34, 0.37], NONE, 0.9, 0.0),
    (Stuff::Stone, "stone", [0.45, 0.42, 0.37], NONE, 0.8, 0.0),
    (Stuff::Frame, "frame", [0.6, 0.58, 0.54], NONE, 0.5, 0.0),
    (Stuff::FrameDark, "frame dark", [0.04, 0.05, 0.05], NONE, 0.4, 0.0),
    (Stuff::Glass, "glass", [0.03, 0.035, 0.04], NONE, 0.03, 0.0),
    (Stuff::PaneDark, "pane dark", [0.02, 0.022, 0.026], NONE, 0.04, 0.0),
    (Stuff::PaneWarm, "pane warm", [0.1, 0.08, 0.06], [0.075, 0.044, 0.018], 0.08, 0.0),
    (Stuff::PaneCool, "pane cool", [0.08, 0.09, 0.1], [0.03, 0.04, 0.05], 0.08, 0.0),
    (Stuff::PaneDim, "pane dim", [0.09, 0.07, 0.05], [0.016, 0.0085, 0.0035], 0.08, 0.0),
    (Stuff::ShopGlass, "shop glass", [0.9, 0.9, 0.9], NONE, 0.02, 0.0),
    (Stuff::ShopWall, "shop wall", [0.62, 0.55, 0.42], NONE, 0.8, 0.0),
    (Stuff::ShopFloor, "shop floor", [0.3, 0.22, 0.15], NONE, 0.5, 0.0),
    (Stuff::ShopLight, "shop light", [0.8, 0.8, 0.8], [0.75, 0.58, 0.36], 0.5, 0.0),
    (Stuff::GoodsRed, "goods red", [0.5, 0.07, 0.05], NONE, 0.5, 0.0),
    (Stuff::GoodsGreen, "goods green", [0.12, 0.35, 0.1], NONE, 0.5, 0.0),
    (Stuff::GoodsYellow, "goods yellow", [0.6, 0.45, 0.08], NONE, 0.5, 0.0),
    (Stuff::GoodsBlue, "goods blue", [0.07, 0.14, 0.42], NONE, 0.5, 0.0),
    (Stuff::AwningRed, "awning red", [0.42, 0.04, 0.035], NONE, 0.8, 0.0),
    (Stuff::AwningWhite, "awning white", [0.6, 0.58, 0.53], NONE, 0.8, 0.0),
    (Stuff::AwningGreen, "awning green", [0.03, 0.17, 0.09], NONE, 0.8, 0.0),
    (Stuff::Steel, "steel", [0.42, 0.43, 0.44], NONE, 0.35, 0.8),
    (Stuff::SteelDark, "steel dark", [0.05, 0.055, 0.06], NONE, 0.4, 0.3),
    (Stuff::LampGlow, "lamp", [0.8, 0.8, 0.8], [20.0, 15.0, 8.2], 0.5, 0.0),
    (Stuff::NeonPink, "neon pink", [0.8, 0.5, 0.6], [7.5, 0.7, 2.6], 0.3, 0.0),
    (Stuff::NeonCyan, "neon cyan", [0.5, 0.7, 0.8], [0.5, 4.6, 6.4], 0.3, 0.0),
    (Stuff::NeonAmber, "neon amber", [0.8, 0.7, 0.5], [8.0, 3.4, 0.5], 0.3, 0.0),
    (Stuff::SignGreen, "sign green", [0.2, 0.5, 0.3], [0.1, 0.95, 0.38], 0.3, 0.0),
    (Stuff::SignRed, "sign red", [0.5, 0.2, 0.15], [1.05, 0.12, 0.07], 0.3, 0.0),
    (Stuff::SignalRed, "signal red", [0.5, 0.1, 0.1], [22.0, 0.9, 0.5], 0.3, 0.0),
    (Stuff::SignalOff, "signal off", [0.05, 0.05, 0.04], NONE, 0.2, 0.0),
    (Stuff::CarPaint, "car paint", [0.025, 0.055, 0.16], NONE, 0.12, 0.0),
    (Stuff::CarGlass, "car glass", [0.015, 0.017, 0.02], NONE, 0.03, 0.0),
    (Stuff::Rubber, "rubber", [0.025, 0.025, 0.026], NONE, 0.8, 0.0),
    (Stuff::Chrome, "chrome", [0.6, 0.6, 0.61], NONE, 0.12, 1.0),
    (Stuff::TailLight, "tail light", [0.35, 0.02, 0.02], [0.05, 0.0014, 0.0014], 0.15, 0.0),
    (Stuff::HeadLight, "head light", [0.5, 0.5, 0.52], NONE, 0.08, 0.3),
    (Stuff::Roof, "roof", [0.07, 0.07, 0.075], NONE, 0.9, 0.0),
    (Stuff::Plastic, "plastic", [0.06, 0.16, 0.1], NONE, 0.45, 0.0),
];

/// Numbers of the materials in the file.
pub struct Palette {
    numbers: Vec<(Stuff, u32)>,
}

impl Palette {
    /// Puts all materials into the file.
    pub fn new(writer: &mut GlbWriter) -> Self {
        let numbers = ROWS.iter().map(|(stuff, name, base, emission, roughness, metal)| {
            let sheet = matches!(
                stuff,
                Stuff::AwningRed
                    | Stuff::AwningWhite
                    | Stuff::AwningGreen
                    | Stuff::NeonPink
                    | Stuff::NeonCyan
                    | Stuff::NeonAmber
            );
            let material = Material {
                name: (*name).into(),
                base: *base,
                emission: *emission,
                roughness: *roughness,
                metal: *metal,
                two_sided: sheet,
                clear: *stuff == Stuff::ShopGlass,
            };
            (*stuff, writer.material(&material))
        });
        Self { numbers: numbers.collect() }
    }

    /// Number of a material.
    pub fn number(&self, stuff: Stuff) -> u32 {
        let row = self.numbers.iter().find(|(other, _)| *other == stuff);
        row.map_or(0, |(_, number)| *number)
    }
}

//! Houses: walls with windows in them, ledges, shops with what is for sale, awnings, signs.

use super::materials::Stuff;
use super::shape::Shape;
use super::sign;
use super::{HALF_LENGTH, HALF_STREET, KERB, Street};
use glam::DVec3;
use std::f64::consts::PI;

/// A house: width, storeys above the ground floor, walls, what is on the ground floor.
struct House {
    width: f64,
    storeys: usize,
    wall: Stuff,
    trim: Stuff,
    shop: Shop,
    /// How far the top ledge stands out, m.
    cornice: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Shop {
    Grocer,
    Bar,
    Cafe,
    Hotel,
    Noodles,
    Flats,
    Closed,
}

const LEFT: [House; 4] = [
    House {
        width: 11.0,
        storeys: 3,
        wall: Stuff::Brick,
        trim: Stuff::Stone,
        shop: Shop::Flats,
        cornice: 0.13,
    },
    House {
        width: 13.0,
        storeys: 3,
        wall: Stuff::Plaster,
        trim: Stuff::Stone,
        shop: Shop::Grocer,
        cornice: 0.45,
    },
    House {
        width: 12.0,
        storeys: 4,
        wall: Stuff::BrickDark,
        trim: Stuff::Stone,
        shop: Shop::Bar,
        cornice: 0.13,
    },
    House {
        width: 12.0,
        storeys: 3,
        wall: Stuff::PlasterBlue,
        trim: Stuff::Frame,
        shop: Shop::Noodles,
        cornice: 0.4,
    },
];
const RIGHT: [House; 4] = [
    House {
        width: 12.0,
        storeys: 3,
        wall: Stuff::PlasterBlue,
        trim: Stuff::Stone,
        shop: Shop::Closed,
        cornice: 0.35,
    },
    House {
        width: 12.0,
        storeys: 4,
        wall: Stuff::Brick,
        trim: Stuff::Stone,
        shop: Shop::Hotel,
        cornice: 0.13,
    },
    House {
        width: 11.0,
        storeys: 3,
        wall: Stuff::Plaster,
        trim: Stuff::Stone,
        shop: Shop::Cafe,
        cornice: 0.4,
    },
    House {
        width: 13.0,
        storeys: 3,
        wall: Stuff::Brick,
        trim: Stuff::Stone,
        shop: Shop::Flats,
        cornice: 0.13,
    },
];

/// Heights: of the pavement at the houses, of the ground floor, of a storey, m.
const FLOOR: f64 = KERB + 0.056;
const GROUND_STOREY: f64 = 3.9;
const STOREY: f64 = 3.05;
/// Depth of a house, m.
const DEPTH: f64 = 8.0;

/// A wall that looks towards −y, in the plane `y`.
fn panel(shape: &mut Shape, stuff: Stuff, [x0, x1]: [f64; 2], [z0, z1]: [f64; 2], y: f64) {
    if x1 - x0 > 1e-6 && z1 - z0 > 1e-6 {
        let at = |x: f64, z: f64| DVec3::new(x, y, z);
        shape.quad(stuff, [at(x0, z0), at(x1, z0), at(x1, z1), at(x0, z1)]);
    }
}

/// A piece of wall with a hole whose sides reach back by `deep`.
fn pierced(
    shape: &mut Shape,
    stuff: Stuff,
    [x0, x1]: [f64; 2],
    [z0, z1]: [f64; 2],
    ([a, b], [c, d]): ([f64; 2], [f64; 2]),
    (y, deep): (f64, f64),
) {
    panel(shape, stuff, [x0, a], [z0, z1], y);
    panel(shape, stuff, [b, x1], [z0, z1], y);
    panel(shape, stuff, [a, b], [z0, c], y);
    panel(shape, stuff, [a, b], [d, z1], y);
    let at = |x: f64, back: f64, z: f64| DVec3::new(x, y + back, z);
    shape.quad(stuff, [at(a, 0.0, c), at(a, deep, c), at(a, deep, d), at(a, 0.0, d)]);
    shape.quad(stuff, [at(b, deep, c), at(b, 0.0, c), at(b, 0.0, d), at(b, deep, d)]);
    shape.quad(stuff, [at(a, 0.0, c), at(b, 0.0, c), at(b, deep, c), at(a, deep, c)]);
    shape.quad(stuff, [at(a, deep, d), at(b, deep, d), at(b, 0.0, d), at(a, 0.0, d)]);
}

/// A ledge: a bar along x that stands out of the wall, its top leaning a little outwards.
fn ledge(shape: &mut Shape, stuff: Stuff, [x0, x1]: [f64; 2], [z0, z1]: [f64; 2], y: f64, out: f64) {
    let at = |x: f64, out: f64, z: f64| DVec3::new(x, y - out, z);
    let fall = 0.06 * out;
    shape.quad(stuff, [at(x0, out, z0), at(x1, out, z0), at(x1, out, z1 - fall), at(x0, out, z1 - fall)]);
    shape.quad(stuff, [at(x0, out, z1 - fall), at(x1, out, z1 - fall), at(x1, 0.0, z1), at(x0, 0.0, z1)]);
    shape.quad(stuff, [at(x0, 0.0, z0), at(x1, 0.0, z0), at(x1, out, z0), at(x0, out, z0)]);
    shape.quad(stuff, [at(x0, 0.0, z0), at(x0, out, z0), at(x0, out, z1 - fall), at(x0, 0.0, z1)]);
    shape.quad(stuff, [at(x1, out, z0), at(x1, 0.0, z0), at(x1, 0.0, z1), at(x1, out, z1 - fall)]);
}

pub(super) fn build(street: &mut Street) {
    for (houses, yaw) in [(&LEFT, 0.0), (&RIGHT, PI)] {
        // Houses of the right side are built on the left and turned round.
        let mut x = -HALF_LENGTH;
        for (number, house) in houses.iter().enumerate() {
            let mut shape = Shape::new();
            let y = HALF_STREET + if number % 2 == 1 { 0.06 } else { 0.0 };
            build_house(street, &mut shape, house, x, y);
            let name = format!("house {} {number}", if yaw == 0.0 { "left" } else { "right" });
            let turned = shape.placed(DVec3::ZERO, yaw);
            street.add(&name, &turned);
            x += house.width;
        }
    }
    end_houses(street);
}

fn build_house(street: &mut Street, shape: &mut Shape, house: &House, x: f64, y: f64) {
    let top = FLOOR + GROUND_STOREY + STOREY * house.storeys as f64 + 0.7;
    let span = [x, x + house.width];
    ground_floor(street, shape, house, span, y);
    let bays = (house.width / 2.7) as usize;
    let pitch = house.width / bays as f64;
    for storey in 0..house.storeys {
        let z0 = FLOOR + GROUND_STOREY + STOREY * storey as f64;
        for bay in 0..bays {
            let x0 = x + pitch * bay as f64;
            let tall = if storey == 0 { 1.75 } else { 1.6 };
            let hole = ([x0 + 0.5 * pitch - 0.55, x0 + 0.5 * pitch + 0.55], [z0 + 0.72, z0 + 0.72 + tall]);
            pierced(shape, house.wall, [x0, x0 + pitch], [z0, z0 + STOREY], hole, (y, 0.16));
            window(street, shape, house, hole, y);
        }
        let out = if storey == 0 { 0.2 } else { 0.09 };
        ledge(shape, house.trim, span, [z0 - 0.1, z0 + 0.06], y, out);
    }
    let parapet = top - 0.7;
    panel(shape, house.wall, span, [parapet, top], y);
    ledge(shape, house.trim, span, [top - 0.12, top + 0.05], y, house.cornice);
    if house.cornice > 0.3 {
        ledge(shape, house.trim, span, [top - 0.3, top - 0.12], y, 0.5 * house.cornice);
    }
    // Back, sides and roof, which lies below the parapet.
    let at = |x: f64, back: f64, z: f64| DVec3::new(x, y + back, z);
    let [x0, x1] = span;
    shape.quad(house.wall, [at(x0, DEPTH, -0.1), at(x0, 0.0, -0.1), at(x0, 0.0, top), at(x0, DEPTH, top)]);
    shape.quad(house.wall, [at(x1, 0.0, -0.1), at(x1, DEPTH, -0.1), at(x1, DEPTH, top), at(x1, 0.0, top)]);
    shape
        .quad(house.wall, [at(x1, DEPTH, -0.1), at(x0, DEPTH, -0.1), at(x0, DEPTH, top), at(x1, DEPTH, top)]);
    let (roof, thick) = (top - 0.45, 0.25);
    shape.quad(
        Stuff::Roof,
        [at(x0, thick, roof), at(x1, thick, roof), at(x1, DEPTH, roof + 0.35), at(x0, DEPTH, roof + 0.35)],
    );
    shape.quad(house.trim, [at(x0, 0.0, top), at(x1, 0.0, top), at(x1, thick, top), at(x0, thick, top)]);
    shape
        .quad(house.wall, [at(x1, thick, roof), at(x0, thick, roof), at(x0, thick, top), at(x1, thick, top)]);
    // A rain pipe beside the house's joint.
    let pipe = [at(x0 + 0.16, -0.09, FLOOR), at(x0 + 0.16, -0.09, top - 0.5)];
    shape.tube(Stuff::SteelDark, pipe, [0.05; 2], 6, [false, true]);
}

/// Pane, bars and sill of a window.
fn window(
    street: &mut Street,
    shape: &mut Shape,
    house: &House,
    ([a, b], [c, d]): ([f64; 2], [f64; 2]),
    y: f64,
) {
    let pane = match street.random.below(12) {
        0 | 1 => Stuff::PaneWarm,
        2 => Stuff::PaneCool,
        3 => Stuff::PaneDim,
        _ => Stuff::PaneDark,
    };
    let back = y + 0.13;
    // Curtains: a lit window is dark at one side.
    let split = if pane == Stuff::PaneDark { b } else { a + (b - a) * street.random.range(0.55, 0.95) };
    panel(shape, pane, [a, split], [c, d], back);
    panel(shape, Stuff::PaneDim, [split, b], [c, d], back);
    let frame = if house.wall == Stuff::Plaster { Stuff::FrameDark } else { Stuff::Frame };
    let mut bar = |x: [f64; 2], z: [f64; 2]| {
        let low = DVec3::new(x[0], y + 0.09, z[0]);
        let open = [false, false, false, true, false, false];
        shape.cuboid(frame, low, DVec3::new(x[1], back, z[1]), open);
    };
    let middle = 0.5 * (a + b);
    bar([a, a + 0.05], [c, d]);
    bar([b - 0.05, b], [c, d]);
    bar([middle - 0.025, middle + 0.025], [c, d]);
    bar([a, b], [c, c + 0.05]);
    bar([a, b], [d - 0.05, d]);
    bar([a, b], [c + 0.6 * (d - c), c + 0.6 * (d - c) + 0.04]);
    ledge(shape, house.trim, [a - 0.1, b + 0.1], [c - 0.09, c], y, 0.17);
    if house.wall != Stuff::PlasterBlue {
        ledge(shape, house.trim, [a - 0.06, b + 0.06], [d, d + 0.12], y, 0.05);
    }
}

fn ground_floor(street: &mut Street, shape: &mut Shape, house: &House, [x0, x1]: [f64; 2], y: f64) {
    let (low, high) = (FLOOR - 0.15, FLOOR + GROUND_STOREY);
    match house.shop {
        Shop::Flats => {
            let third = (x1 - x0) / 3.0;
            for bay in [0.0, 1.0, 2.0] {
                let [a, b] = [x0 + third * bay, x0 + third * (bay + 1.0)];
                let middle = 0.5 * (a + b);
                if bay == 1.0 {
                    let door = ([middle - 0.65, middle + 0.65], [FLOOR + 0.2, FLOOR + 2.9]);
                    pierced(shape, house.wall, [a, b], [low, high], door, (y, 0.4));
                    panel(shape, Stuff::FrameDark, door.0, [FLOOR + 0.2, FLOOR + 2.35], y + 0.36);
                    panel(shape, Stuff::PaneWarm, door.0, [FLOOR + 2.35, FLOOR + 2.9], y + 0.36);
                    shape.block(
                        house.trim,
                        [door.0[0] - 0.15, y - 0.35, low],
                        [door.0[1] + 0.15, y + 0.4, FLOOR + 0.2],
                    );
                    ledge(
                        shape,
                        house.trim,
                        [door.0[0] - 0.25, door.0[1] + 0.25],
                        [FLOOR + 3.0, FLOOR + 3.2],
                        y,
                        0.45,
                    );
                } else {
                    let hole = ([middle - 0.75, middle + 0.75], [FLOOR + 1.0, FLOOR + 2.9]);
                    pierced(shape, house.wall, [a, b], [low, high], hole, (y, 0.16));
                    window(street, shape, house, hole, y);
                }
            }
            ledge(shape, house.trim, [x0, x1], [FLOOR + 0.5, FLOOR + 0.6], y, 0.05);
        }
        shop => {
            let sides = [x0 + 0.55, x1 - 0.55];
            let hole = (sides, [FLOOR, FLOOR + 2.95]);
            pierced(shape, house.trim, [x0, x1], [low, high], hole, (y, 0.25));
            storefront(street, shape, shop, sides, y);
            fascia(shape, shop, [x0 + 0.3, x1 - 0.3], y);
        }
    }
}

/// The room behind a shop's window, its door and what is in it.
fn storefront(street: &mut Street, shape: &mut Shape, shop: Shop, [a, b]: [f64; 2], y: f64) {
    let (low, high, deep) = (FLOOR + 0.02, FLOOR + 2.95, 3.0);
    if shop == Shop::Closed {
        // A shutter of slats.
        for slat in 0..20 {
            let z = low + 0.147 * slat as f64;
            let at = |x: f64, back: f64, z: f64| DVec3::new(x, y + back, z);
            shape.quad(
                Stuff::Steel,
                [at(a, 0.14, z), at(b, 0.14, z), at(b, 0.2, z + 0.147), at(a, 0.2, z + 0.147)],
            );
        }
        return;
    }
    let at = |x: f64, back: f64, z: f64| DVec3::new(x, y + 0.25 + back, z);
    shape.quad(Stuff::ShopFloor, [at(a, -0.25, low), at(b, -0.25, low), at(b, deep, low), at(a, deep, low)]);
    shape.quad(Stuff::ShopWall, [at(a, deep, high), at(b, deep, high), at(b, 0.0, high), at(a, 0.0, high)]);
    shape.quad(Stuff::ShopWall, [at(a, deep, low), at(b, deep, low), at(b, deep, high), at(a, deep, high)]);
    shape.quad(Stuff::ShopWall, [at(a, 0.0, low), at(a, deep, low), at(a, deep, high), at(a, 0.0, high)]);
    shape.quad(Stuff::ShopWall, [at(b, deep, low), at(b, 0.0, low), at(b, 0.0, high), at(b, deep, high)]);
    // Strips of light below the ceiling.
    let strips = ((b - a) / 2.4) as usize;
    for strip in 0..strips {
        let middle = a + (b - a) * (strip as f64 + 0.5) / strips as f64;
        let z = high - 0.12;
        shape.quad(
            Stuff::ShopLight,
            [
                at(middle - 0.6, 1.35, z),
                at(middle + 0.6, 1.35, z),
                at(middle + 0.6, 1.0, z),
                at(middle - 0.6, 1.0, z),
            ],
        );
    }
    // Below the glass a sill, in it a door.
    let door = if shop == Shop::Bar { a + 1.2 } else { 0.5 * (a + b) };
    for [from, to] in [[a, door - 0.55], [door + 0.55, b]] {
        shape.block(Stuff::FrameDark, [from, y + 0.08, low - 0.1], [to, y + 0.25, low + 0.5]);
        panel(shape, Stuff::ShopGlass, [from, to], [low + 0.5, high], y + 0.15);
        let panes = ((to - from) / 1.7).ceil().max(1.0);
        for post in 0..=panes as usize {
            let x = from + (to - from) * post as f64 / panes;
            shape.block(Stuff::FrameDark, [x - 0.03, y + 0.1, low + 0.5], [x + 0.03, y + 0.2, high]);
        }
    }
    panel(shape, Stuff::ShopGlass, [door - 0.5, door + 0.5], [low + 0.1, low + 2.2], y + 0.2);
    shape.block(Stuff::FrameDark, [door - 0.55, y + 0.17, low], [door - 0.47, y + 0.24, low + 2.3]);
    shape.block(Stuff::FrameDark, [door + 0.47, y + 0.17, low], [door + 0.55, y + 0.24, low + 2.3]);
    shape.block(Stuff::FrameDark, [door - 0.55, y + 0.17, low + 2.2], [door + 0.55, y + 0.24, low + 2.34]);
    goods(street, shape, shop, [a, b], y + 0.25, low);
}

/// Shelves and tables with goods.
fn goods(street: &mut Street, shape: &mut Shape, shop: Shop, [a, b]: [f64; 2], y: f64, low: f64) {
    let colours = [Stuff::GoodsRed, Stuff::GoodsGreen, Stuff::GoodsYellow, Stuff::GoodsBlue, Stuff::ShopWall];
    let open = [false, false, false, true, true, false];
    if matches!(shop, Shop::Grocer | Shop::Bar) {
        for shelf in 0..4 {
            let z = low + 0.7 + 0.5 * shelf as f64;
            shape.cuboid(
                Stuff::ShopFloor,
                DVec3::new(a + 0.2, y + 2.6, z - 0.04),
                DVec3::new(b - 0.2, y + 3.0, z),
                open,
            );
            let mut x = a + 0.3;
            while x < b - 0.5 {
                let wide = street.random.range(0.12, 0.45);
                let tall = street.random.range(0.15, 0.38);
                let colour = colours[street.random.below(5) as usize];
                shape.cuboid(
                    colour,
                    DVec3::new(x, y + 2.65, z),
                    DVec3::new(x + wide, y + 2.95, z + tall),
                    open,
                );
                x += wide + street.random.range(0.03, 0.2);
            }
        }
    }
    if shop == Shop::Grocer {
        // Crates behind the glass.
        let mut x = a + 0.25;
        while x < b - 0.9 {
            let colour = colours[street.random.below(3) as usize];
            shape.block(Stuff::ShopFloor, [x, y + 0.1, low], [x + 0.7, y + 0.7, low + 0.75]);
            shape.block(colour, [x + 0.04, y + 0.14, low + 0.75], [x + 0.66, y + 0.66, low + 0.88]);
            x += 0.85;
        }
    } else {
        // Tables with stools; people are not at home tonight.
        let mut x = a + 1.0;
        while x < b - 0.8 {
            let table = DVec3::new(x, y + 0.9, low);
            shape.tube(Stuff::SteelDark, [table, table + DVec3::Z * 0.74], [0.04; 2], 6, [false; 2]);
            shape.disc(Stuff::ShopFloor, table + DVec3::Z * 0.75, DVec3::Z, 0.36, 12);
            shape.disc(Stuff::SteelDark, table + DVec3::Z * 0.74, DVec3::NEG_Z, 0.36, 12);
            for side in [-0.6, 0.6] {
                let stool = table + DVec3::new(side, 0.1, 0.0);
                shape.tube(Stuff::GoodsRed, [stool, stool + DVec3::Z * 0.46], [0.13, 0.17], 8, [false, true]);
            }
            x += 1.9;
        }
    }
}

/// What hangs over a shop: its board, an awning, neon.
fn fascia(shape: &mut Shape, shop: Shop, [a, b]: [f64; 2], y: f64) {
    let (low, high) = (FLOOR + 3.0, FLOOR + 3.6);
    shape.block(Stuff::FrameDark, [a, y - 0.14, low], [b, y, high]);
    let (right, up) = (DVec3::X, DVec3::Z);
    let mut text = |stuff: Stuff, text: &str, height: f64| {
        let advance = height * 0.86;
        let width = advance * text.len() as f64 - 0.26 * height;
        let at = DVec3::new(0.5 * (a + b) - 0.5 * width, y - 0.2, 0.5 * (low + high) - 0.5 * height);
        sign::word(shape, stuff, text, at, (right, up), (height, right * advance));
    };
    match shop {
        Shop::Grocer => text(Stuff::NeonAmber, "FOOD", 0.42),
        Shop::Bar => text(Stuff::NeonPink, "BAR", 0.46),
        Shop::Cafe => text(Stuff::NeonCyan, "CAFE", 0.42),
        Shop::Noodles => text(Stuff::NeonAmber, "NOODLES", 0.4),
        Shop::Hotel => text(Stuff::NeonPink, "HOTEL", 0.36),
        Shop::Flats | Shop::Closed => {}
    }
    match shop {
        Shop::Grocer => awning(shape, [a + 0.4, b - 0.4], y, [Stuff::AwningGreen, Stuff::AwningWhite]),
        Shop::Cafe => awning(shape, [a + 0.4, b - 0.4], y, [Stuff::AwningRed, Stuff::AwningWhite]),
        Shop::Hotel => canopy(shape, 0.5 * (a + b), y),
        Shop::Bar => blade(shape, a + 0.5, y, "BAR", Stuff::NeonCyan),
        Shop::Noodles => blade(shape, b - 0.6, y, "OPEN", Stuff::NeonPink),
        Shop::Flats | Shop::Closed => {}
    }
    if shop == Shop::Hotel {
        blade(shape, b - 0.4, y, "HOTEL", Stuff::NeonAmber);
    }
}

/// A striped sheet that leans out over the pavement, with a border that hangs.
fn awning(shape: &mut Shape, [a, b]: [f64; 2], y: f64, stripes: [Stuff; 2]) {
    let (out, top, low) = (1.35, FLOOR + 2.98, FLOOR + 2.42);
    let count = ((b - a) / 0.42) as usize;
    for stripe in 0..count {
        let x =
            [a + (b - a) * stripe as f64 / count as f64, a + (b - a) * (stripe + 1) as f64 / count as f64];
        let stuff = stripes[stripe % 2];
        let at = |x: f64, out: f64, z: f64| DVec3::new(x, y - 0.02 - out, z);
        shape.quad(stuff, [at(x[0], out, low), at(x[1], out, low), at(x[1], 0.0, top), at(x[0], 0.0, top)]);
        shape.quad(
            stuff,
            [at(x[0], out, low - 0.2), at(x[1], out, low - 0.2), at(x[1], out, low), at(x[0], out, low)],
        );
    }
    for x in [a, b] {
        let at = |out: f64, z: f64| DVec3::new(x, y - 0.02 - out, z);
        shape.polygon(stripes[0], &[at(0.0, low), at(out, low), at(0.0, top)]);
    }
}

/// A flat roof over a door, on two rods.
fn canopy(shape: &mut Shape, middle: f64, y: f64) {
    let z = FLOOR + 2.75;
    shape.block(Stuff::SteelDark, [middle - 1.5, y - 1.7, z], [middle + 1.5, y, z + 0.16]);
    shape.block(Stuff::LampGlow, [middle - 0.25, y - 0.95, z - 0.02], [middle + 0.25, y - 0.8, z]);
    for side in [-1.3, 1.3] {
        let rod = [DVec3::new(middle + side, y - 1.6, z + 0.16), DVec3::new(middle + side, y, z + 1.2)];
        shape.tube(Stuff::Steel, rod, [0.015; 2], 5, [false; 2]);
    }
}

/// A sign that stands out of the wall, to be read from along the street.
fn blade(shape: &mut Shape, x: f64, y: f64, text: &str, stuff: Stuff) {
    let letter = 0.44;
    let tall = (letter + 0.16) * text.len() as f64 + 0.16;
    let low = FLOOR + 4.1;
    shape.block(Stuff::SteelDark, [x - 0.07, y - 0.12 - 0.62, low], [x + 0.07, y - 0.12, low + tall]);
    for z in [low + 0.3, low + tall - 0.3] {
        shape.block(Stuff::SteelDark, [x - 0.02, y - 0.14, z], [x + 0.02, y, z + 0.05]);
    }
    for (side, right) in [(-1.0, DVec3::NEG_Y), (1.0, DVec3::Y)] {
        // Seen from −x the picture's right is −y, from +x it is +y.
        let from = if side < 0.0 { y - 0.12 - 0.16 } else { y - 0.12 - 0.46 };
        let at = DVec3::new(x + side * 0.12, from - 0.02, low + tall - 0.16 - letter);
        sign::word(shape, stuff, text, at, (right, DVec3::Z), (letter, DVec3::NEG_Z * (letter + 0.16)));
    }
    let corner = DVec3::new(x - 0.1, y - 0.12 - 0.6, low + 0.03);
    let sides = (DVec3::Y * 0.56, DVec3::Z * (tall - 0.06));
    let glow = if stuff == Stuff::NeonPink { Stuff::NeonCyan } else { Stuff::NeonPink };
    sign::frame(shape, glow, corner, sides);
}

/// Houses across the far end of the street, and sides that close what is behind.
fn end_houses(street: &mut Street) {
    let house = House {
        width: 16.0,
        storeys: 4,
        wall: Stuff::BrickDark,
        trim: Stuff::Stone,
        shop: Shop::Flats,
        cornice: 0.3,
    };
    for (number, x) in [-16.0, 0.0].into_iter().enumerate() {
        let mut shape = Shape::new();
        // Built as the left side's, with its front at y = 0, then turned to look along −x.
        let house = House { wall: if number == 0 { Stuff::PlasterBlue } else { Stuff::BrickDark }, ..house };
        build_house(street, &mut shape, &house, x, 0.0);
        let at = DVec3::new(HALF_LENGTH + 9.0, 0.0, 0.0);
        street.add(&format!("house end {number}"), &shape.placed(at, -0.5 * PI));
    }
}

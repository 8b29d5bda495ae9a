//! How many instructions each shader has, by naga: what a pass costs where no card is at hand, before any loop is run twice.

use super::{ALL, Shader};
use wgpu::naga;

/// Instructions that an entry point may run, each written place counted once: those of functions at every call.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    /// Sums, products, comparisons, functions of mathematics.
    arithmetic: u32,
    /// Loads from buffers, and texels that are read.
    reads: u32,
    /// Texels that the hardware's filter reads.
    samples: u32,
    /// Stores into buffers and textures, atomic ones too.
    writes: u32,
    loops: u32,
}

impl Counts {
    fn add(&mut self, other: Self) {
        self.arithmetic += other.arithmetic;
        self.reads += other.reads;
        self.samples += other.samples;
        self.writes += other.writes;
        self.loops += other.loops;
    }

    fn all(self) -> u32 {
        self.arithmetic + self.reads + self.samples + self.writes
    }
}

/// Whether a pointer leads out of the function, to a buffer.
fn is_buffer(
    module: &naga::Module,
    function: &naga::Function,
    pointer: naga::Handle<naga::Expression>,
) -> bool {
    use naga::Expression;
    match function.expressions[pointer] {
        Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
            is_buffer(module, function, base)
        }
        Expression::GlobalVariable(variable) => matches!(
            module.global_variables[variable].space,
            naga::AddressSpace::Storage { .. } | naga::AddressSpace::Uniform
        ),
        _ => false,
    }
}

fn expressions(module: &naga::Module, function: &naga::Function) -> Counts {
    use naga::Expression;
    let mut counts = Counts::default();
    for (_, expression) in function.expressions.iter() {
        match expression {
            Expression::Binary { .. }
            | Expression::Unary { .. }
            | Expression::Math { .. }
            | Expression::Select { .. }
            | Expression::Relational { .. }
            | Expression::As { .. } => counts.arithmetic += 1,
            Expression::ImageLoad { .. } => counts.reads += 1,
            Expression::ImageSample { .. } => counts.samples += 1,
            Expression::Load { pointer } if is_buffer(module, function, *pointer) => counts.reads += 1,
            _ => {}
        }
    }
    counts
}

/// What a block's statements write and whom they call, loops and branches inside.
fn statements(
    (module, function): (&naga::Module, &naga::Function),
    block: &naga::Block,
    of: &dyn Fn(naga::Handle<naga::Function>) -> Counts,
) -> Counts {
    use naga::Statement;
    let mut counts = Counts::default();
    let inside = |block: &naga::Block| statements((module, function), block, of);
    for statement in block.iter() {
        match statement {
            Statement::Block(block) => counts.add(inside(block)),
            Statement::If { accept, reject, .. } => {
                counts.add(inside(accept));
                counts.add(inside(reject));
            }
            Statement::Switch { cases, .. } => cases.iter().for_each(|case| counts.add(inside(&case.body))),
            Statement::Loop { body, continuing, .. } => {
                counts.loops += 1;
                counts.add(inside(body));
                counts.add(inside(continuing));
            }
            Statement::Store { pointer, .. } if is_buffer(module, function, *pointer) => counts.writes += 1,
            Statement::ImageStore { .. } | Statement::Atomic { .. } => counts.writes += 1,
            Statement::Call { function, .. } => counts.add(of(*function)),
            _ => {}
        }
    }
    counts
}

fn of_function(module: &naga::Module, function: &naga::Function) -> Counts {
    let mut counts = expressions(module, function);
    let of = |called| of_function(module, &module.functions[called]);
    counts.add(statements((module, function), &function.body, &of));
    counts
}

fn entries(shader: &Shader) -> Vec<(String, Counts)> {
    let module = naga::front::wgsl::parse_str(&shader.source()).expect("a shader that parses");
    let entry = |entry: &naga::EntryPoint| (entry.name.clone(), of_function(&module, &entry.function));
    module.entry_points.iter().map(entry).collect()
}

#[test]
fn what_lies_between_nodes_takes_a_fraction_of_the_instructions_that_working_it_out_takes() {
    /// Of those of pixels that no node tells; a wide margin below the five times that were found.
    const FRACTION: u32 = 3;
    println!("| shader · entry | arithmetic | reads | filtered | writes | loops |");
    let mut totals = std::collections::BTreeMap::new();
    for shader in ALL {
        for (name, counts) in entries(shader) {
            let Counts { arithmetic, reads, samples, writes, loops } = counts;
            println!(
                "| {} · {name} | {arithmetic} | {reads} | {samples} | {writes} | {loops} |",
                shader.name
            );
            *totals.entry(shader.name).or_insert(0) += counts.all();
        }
    }
    assert!(FRACTION * totals["town_pixels"] < totals["town_rest"], "{totals:?}");
    let march = entries(ALL.iter().find(|shader| shader.name == "march").unwrap());
    assert!(
        march.iter().any(|(_, counts)| counts.samples > 0),
        "the march reads light by the hardware's filter"
    );
}

#[test]
fn a_functions_instructions_count_at_every_call() {
    let source = "
        @group(0) @binding(0) var<storage, read_write> cells: array<f32>;
        fn square(a: f32) -> f32 { return a * a; }
        @compute @workgroup_size(1) fn once() { cells[0] = square(cells[1]); }
        @compute @workgroup_size(1) fn twice() { cells[0] = square(square(cells[1])); }";
    let module = naga::front::wgsl::parse_str(source).unwrap();
    let counts = |at: usize| of_function(&module, &module.entry_points[at].function);
    assert_eq!(counts(0), Counts { arithmetic: 1, reads: 1, writes: 1, ..Counts::default() });
    assert_eq!(counts(1), Counts { arithmetic: 2, ..counts(0) });
}

# Short commands for the ones that CONTRIBUTING.md names; `just --list` shows them.

# Bake the sample storm and render it.
storm:
    cargo run --release -- bake data/storm/storm.toml -o storm.squall --preview storm.png

# All tests.
test:
    cargo test --workspace --release

# Formatting, lints, documentation, as .ci/run checks them.
check:
    cargo fmt --all -- --check
    cargo clippy --workspace --all-targets -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps

# Documentation in a browser.
doc:
    cargo doc --workspace --no-deps --open

# The charts of docs/charts.
charts:
    cargo run --release -- chart data/storm/storm.toml -o docs/charts

# Fuzz each target for some seconds.
fuzz seconds="60":
    .ci/fuzz {{seconds}}

# Advisories and licences of dependencies.
deny:
    cargo deny check

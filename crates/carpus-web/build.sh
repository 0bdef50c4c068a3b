#!/usr/bin/env bash
# What reports embed (crates/carpus-report/src/assets/live), made of this crate, the crates it uses, and the front end.
#
#   crates/carpus-web/build.sh            builds all; needs the target wasm32-unknown-unknown and npm
#   crates/carpus-web/build.sh --compile  compiles the crate only
#   crates/carpus-web/build.sh --check    whether what is committed was built of these sources; needs nothing
set -euo pipefail
cd "$(dirname "$0")/../.."
assets=crates/carpus-report/src/assets/live
page=crates/carpus-web/page
crates="numerics osim multibody study simulation effects diagnosis personalization web"

# Sources in a fixed order, and the versions of the libraries that they use.
sources() {
  {
    for crate in $crates; do
      find crates/carpus-$crate/src crates/carpus-$crate/Cargo.toml -type f
    done
    find crates/carpus-web/build.sh crates/carpus-web/bindings/src $page/src -type f
    find $page -maxdepth 1 -name 'package*.json'
  } | LC_ALL=C sort | xargs sha256sum
  cargo tree --locked --package carpus-web --target wasm32-unknown-unknown --edges normal --prefix none --no-dedupe |
    sed 's/ (.*//' | LC_ALL=C sort -u
}
hash=$(sources | sha256sum | cut -d' ' -f1)

if [ "${1:-}" = --check ]; then
  [ "$(cat $assets/SOURCES.sha256)" = "$hash" ] && exit 0
  echo "$assets was built of other sources: run crates/carpus-web/build.sh and commit what it changes" >&2
  exit 1
fi

built=target/wasm32-unknown-unknown/web
# Vectors of two numbers: every browser has them that can unpack a report. Places of sources in messages do not depend on
# the machine.
flags="-C target-feature=+simd128 --remap-path-prefix=$PWD=. --remap-path-prefix=$(rustc --print sysroot)=rust"
for registry in "${CARGO_HOME:-$HOME/.cargo}"/registry/src/*; do flags+=" --remap-path-prefix=$registry=."; done
export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS="$flags"
cargo rustc --locked --package carpus-web --target wasm32-unknown-unknown --profile web --crate-type cdylib
[ "${1:-}" = --compile ] && exit 0
cargo run --quiet --locked --manifest-path crates/carpus-web/bindings/Cargo.toml --target-dir target/tools -- \
  $built/carpus_web.wasm $built/bindings
[ -d $page/node_modules/three ] || (cd $page && npm ci --no-audit --no-fund)
tools=$page/node_modules/.bin
mkdir -p $assets
gzip -9 -n -c $built/bindings/carpus_web_bg.wasm >$assets/carpus_web.wasm.gz
esbuild() { $tools/esbuild "$@" --minify --charset=utf8 --log-level=warning; }
bindings=./$built/bindings/carpus_web.js
esbuild $page/src/worker.js --bundle --format=iife --alias:carpus-web=$bindings --outfile=$assets/worker.js
esbuild $page/src/main.js --bundle --format=iife --outfile=$assets/page.js
esbuild $page/src/model/main.js --bundle --format=iife --outfile=$assets/model.js
# What draws in three dimensions: three.js, of it what is used, with its licence.
esbuild $page/src/scene/index.js --bundle --format=iife --global-name=carpusScene --legal-comments=none \
  --banner:js="/*! three.js: $(tr '\n' ' ' <$page/node_modules/three/LICENSE) */" --outfile=$built/scene.js
gzip -9 -n -c $built/scene.js >$assets/scene.js.gz
esbuild $page/src/live.css --outfile=$assets/live.css
echo "$hash" >$assets/SOURCES.sha256
wc -c $assets/*

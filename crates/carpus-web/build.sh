#!/usr/bin/env bash
# What reports embed (crates/carpus-report/src/assets/live), made of this crate, the crates it uses, and the front end in page/.
#
#   crates/carpus-web/build.sh            builds all; needs the target wasm32-unknown-unknown and npm
#   crates/carpus-web/build.sh --check    whether what is committed was built of these sources; needs nothing
set -euo pipefail
cd "$(dirname "$0")/../.."
assets=crates/carpus-report/src/assets/live
page=crates/carpus-web/page
crates="numerics osim multibody study simulation personalization diagnosis web"

# Sources in a fixed order, and the versions of the libraries that they use.
sources() {
  { for crate in $crates; do find crates/carpus-$crate -type f \( -name '*.rs' -o -name Cargo.toml -o -name build.sh \); done
    find $page -maxdepth 1 -name 'package*.json'; find $page/src -type f; } | LC_ALL=C sort | xargs sha256sum
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
# Places of sources in messages do not depend on the machine.
home=${CARGO_HOME:-$HOME/.cargo}
sysroot=$(rustc --print sysroot)
export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS="--remap-path-prefix=$home/registry/src=. \
  --remap-path-prefix=$sysroot=rust --remap-path-prefix=$PWD=."
cargo rustc --locked --package carpus-web --target wasm32-unknown-unknown --profile web --crate-type cdylib
cargo run --quiet --locked --manifest-path crates/carpus-web/bindings/Cargo.toml --target-dir target/tools -- \
  $built/carpus_web.wasm $built/bindings
[ -d $page/node_modules ] || (cd $page && npm ci --no-audit --no-fund)
tools=$page/node_modules/.bin
$tools/wasm-opt -O3 --enable-bulk-memory --enable-nontrapping-float-to-int --enable-sign-ext --enable-mutable-globals \
  --enable-multivalue --enable-reference-types $built/bindings/carpus_web_bg.wasm -o $built/carpus_web.opt.wasm
mkdir -p $assets
gzip -9 -n -c $built/carpus_web.opt.wasm >$assets/carpus_web.wasm.gz
bundle() { $tools/esbuild "$1" --bundle --format=iife --minify --charset=utf8 --log-level=warning --alias:carpus-web=./$built/bindings/carpus_web.js --outfile="$2"; }
bundle $page/src/worker.js $assets/worker.js
bundle $page/src/main.js $assets/page.js
$tools/esbuild $page/src/live.css --minify --charset=utf8 --log-level=warning --outfile=$assets/live.css
echo "$hash" >$assets/SOURCES.sha256
wc -c $assets/*

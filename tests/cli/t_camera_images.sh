# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# What cameras saw as numbered images, as `l4dtrain capture` writes them.
make_scene s.ply 800
make_cameras videos.json
mkdir set set/cam0 set/cam2 outside
# cameras FROM FILE: images in place of videos; the images of camera k are FROMk/%04d.png.
cameras() { sed -E "s|\"video\": \"cam([0-9]).mp4\"|\"images\": \"$1\1/%04d.png\"|g" videos.json > "$2"; }
cameras cam set/c.json
for k in 0 2; do
  expect 0 render s.ply --cameras set/c.json --camera $k --range 0:0.2 -o "set/cam$k/%04d.png"
done
expect_document 0 compare s.ply s.ply --cameras set/c.json --frames 0:6 --images --per-view
expect_json out 'd["views"] == 12 and min(v["psnr_a_db"] for v in d["per_view"]) > 50'
expect 0 encode s.ply -o s.l4d --cameras set/c.json --frames 0:6:5 --target-psnr-loss 25dB

# An image of another frame, of another size, and one that is missing.
cp set/cam0/0001.png kept.png
cp set/cam0/0005.png set/cam0/0001.png
expect_document 0 compare s.ply s.ply --cameras set/c.json --ids 0 --frames 1 --images
expect_json out 'd["psnr_a_db"] < 50'
# A mask leaves its pixels: here a corner without Gaussians, or none.
for pixels in 12 0; do
  "$PYTHON" -c 'import struct, sys, zlib
def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
n = int(sys.argv[1])
rows = b"".join(b"\0" + bytes(255 * (x < n and y < n) for x in range(96)) for y in range(64))
sys.stdout.buffer.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 96, 64, 8, 0, 0, 0, 0)) +
                        chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))' $pixels > set/mask$pixels.png
  sed "s|\"images\"|\"mask\": \"mask$pixels.png\", \"images\"|g" set/c.json > set/masked$pixels.json
done
expect_document 0 compare s.ply s.ply --cameras set/masked12.json --ids 0 --frames 1 --images
expect_json out 'd["psnr_a_db"] > 54 and d["ssim_a"] > 0.999'
expect 4 compare s.ply s.ply --cameras set/masked0.json --ids 0 --frames 1 --images
expect_text err 'camera 0: by its mask, set/mask0.png, none of its pixels counts$'
expect 0 render s.ply --cameras set/c.json --scale 0.5 -f -o set/cam0/small.png
mv set/cam0/small.png set/cam0/0001.png
expect 4 compare s.ply s.ply --cameras set/c.json --ids 0 --frames 0:6 --images
expect_text err 'camera 0: set/cam0/0001.png has 48 x 32 pixels, and the camera has 96 x 64$'
cp kept.png set/cam0/0001.png
expect 3 compare s.ply s.ply --cameras set/c.json --ids 0 --frames 6 --images
expect_text err 'set/cam0/0006.png'

# They are read from the folder of the file alone, and written never.
expect 2 compare s.ply s.l4d --cameras set/c.json --frames 0 --side-by-side set/cam2/0003.png -f
expect_text err 'are the same file$'
mv set/cam2/0000.png first.png  # frames before it may be missing
expect 2 compare s.ply s.l4d --cameras set/c.json --frames 3 --ids 2 --images --side-by-side set/cam2/0003.png -f
expect_text err 'are the same file$'
mv first.png set/cam2/0000.png
mv set/cam0 outside/
for from in ../outside/cam "$PWD/outside/cam"; do
  cameras "$from" set/out.json
  expect 2 compare s.ply s.ply --cameras set/out.json --ids 0 --frames 0:6 --images
  expect_text err 'camera 0: .*outside/cam0/%04d.png is not in the folder of the cameras; --any-path'
  expect 0 compare s.ply s.ply --cameras set/out.json --ids 0 --frames 0:6 --images --any-path
done

# Paths are no formats: only one whole number is filled in.
for pattern in %s %n %04x %ld cam0 %; do
  sed -E "s|cam[0-9]/%04d.png|$pattern|g" set/c.json > set/wrong.json
  expect 4 compare s.ply s.ply --cameras set/wrong.json --ids 2 --frames 0 --images
  expect_text err 'a path of numbered images has one %d or %04d'
  expect 0 compare s.ply s.ply --cameras set/wrong.json --ids 2 --frames 0
done
sed -E "s|(cam[0-9])/%04d.png|\1/%04d%s%n.png|g" set/c.json > set/more.json
expect 3 compare s.ply s.ply --cameras set/more.json --ids 2 --frames 0 --images
expect_text err 'cam2/0000%s%n.png'

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# Several processes under mpirun measure one scene together: the file does not depend on how many.
command -v mpirun > /dev/null || exit 77
# A build without MPI takes each process for the only one.
[[ $(ldd "$L4DCODEC") == *libmpi* ]] || exit 77
make_scene s.ply 3000
make_cameras c.json

# ranks N ARGUMENT...: the tool in N processes, without binding them to cores that others use.
ranks() {
  local n=$1
  shift
  OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_hwloc_base_binding_policy=none \
    mpirun --oversubscribe -n "$n" "$L4DCODEC" "$@" > out 2> err
}

for n in 1 2 3; do
  ranks $n sensitivity s.ply --cameras c.json -o w$n.ply --all-views --json ||
    die "sensitivity with $n ranks: $(cat err)"
  # One document, of one rank.
  expect_json out 'd["views_measured"] == d["views"] and d["views"] > 3'
done
cmp w1.ply w2.ply
cmp w1.ply w3.ply
# So it is in rounds that end when halves agree, and for views that are only asked.
for n in 1 2; do
  ranks $n sensitivity s.ply --cameras c.json -o r$n.ply --max-share 0.4 --metric sum || die "$(cat err)"
done
cmp r1.ply r2.ply

# Encoding takes the same weights, and one rank writes.
ranks 2 encode s.ply --cameras c.json -o two.l4d --all-views --json || die "encode: $(cat err)"
ranks 1 encode s.ply --cameras c.json -o one.l4d --all-views --json || die "encode: $(cat err)"
cmp one.l4d two.l4d
expect 0 validate two.l4d
# What has no share in it is done once.
ranks 2 info two.l4d --json || die "info: $(cat err)"
expect_json out 'd["num_gaussians"] > 0'
# A rank that fails takes the others with it, and tells its exit status.
status=0
ranks 2 sensitivity missing.ply --cameras c.json -o x.ply || status=$?
[ "$status" -eq 3 ] || die "a missing scene: exit status $status"
expect_missing x.ply

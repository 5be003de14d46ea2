#!/usr/bin/env bash
# Boots the guest once and tests in it. Exit 0 passed, 1 failed, 77 not possible here (standard error says why).
#   run.sh OUT RENDER_FRAMES PROGRAM...     the programs are taken along; OUT receives console, journal and trace
# GRANARY_VM_CACHE (~/.cache/granary-vm) holds the image, GRANARY_VM_LIMIT (650) is the longest the guest may take, in s.
# An emulated guest on a machine that is busy with other things may miss what a real one would not: a run that fails is
# repeated once, and both say so.
set -euo pipefail

out=$1 render_frames=$2
shift 2
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
cache=${GRANARY_VM_CACHE:-$HOME/.cache/granary-vm}
PATH=$PATH:/sbin:/usr/sbin

skip() {
  echo "vm: skipped: $*" >&2
  exit 77
}

[[ $(. /etc/os-release && echo "${VERSION_CODENAME:-}") == bookworm ]] ||
  skip "the guest is Debian 12 and runs what was built here, so this has to be Debian 12, too"
missing=()
command -v qemu-system-x86_64 >/dev/null || missing+=(qemu-system-x86)
command -v mke2fs >/dev/null || missing+=(e2fsprogs)
[[ ${#missing[@]} -eq 0 ]] || skip "missing, as root: apt-get install --no-install-recommends ${missing[*]}"

status=0
"$here/build-image.sh" "$cache" || status=$?
[[ $status -ne 77 ]] || skip "there is no image, and it cannot be built"
[[ $status -eq 0 ]] || exit 1

rm -rf "$out"
mkdir -p "$out"/{host,payload/bin,payload/lib}
payload=$out/payload
cp "$@" "$payload/bin/"
strip "$payload"/bin/*
# The libraries that the programs need and the guest has not.
ldd "$@" | awk '$3 ~ "^/" {print $3}' | sort -u | while read -r library; do
  grep -qxF "${library##*/}" "$cache/libraries" || cp -L "$library" "$payload/lib/"
done
cp -r "$here/guest" "$root/systemd" "$payload/"
"$render_frames" "$root/config/sim" "$payload/frames"
mke2fs -q -F -t ext4 -O ^has_journal -m 0 -d "$payload" "$out/payload.img" "$(($(du -sm "$payload" | cut -f1) * 11 / 10 + 20))M"
rm -rf "$payload"

accelerator=tcg,thread=multi,tb-size=512
[[ ! -w /dev/kvm ]] || accelerator=kvm
boot() {
  local status=0
  timeout -k 5 "${GRANARY_VM_LIMIT:-650}" qemu-system-x86_64 -nodefaults -no-user-config -no-reboot -display none \
    -serial stdio -machine q35 -accel "$accelerator" -cpu max -smp 2 -m 2048 \
    -kernel "$cache/vmlinuz" -initrd "$cache/initrd" -append "console=ttyS0 quiet panic=-1 tsc=reliable mitigations=off \
random.trust_cpu=on systemd.show_status=0 ${GRANARY_VM_APPEND:-}" \
    -drive "file=$cache/root.img,if=none,id=root,format=raw,snapshot=on" -device virtio-blk-pci,drive=root \
    -drive "file=$out/payload.img,if=none,id=payload,format=raw,readonly=on" -device virtio-blk-pci,drive=payload \
    -virtfs "local,path=$out/host,mount_tag=host,security_model=none" \
    -device virtio-rng-pci -device isa-debug-exit,iobase=0x501,iosize=2 </dev/null | tee "$out/console$1.log" || status=$?
  case $status in
    33) echo "vm: run $1 passed; journal, kernel log and trace are in $out/host" ;;
    35) echo "vm: run $1 failed; journal, kernel log and trace are in $out/host" ;;
    124) echo "vm: run $1 did not finish within ${GRANARY_VM_LIMIT:-650} s" ;;
    *) echo "vm: run $1 ended without a verdict (qemu: $status)" ;;
  esac
  [[ $status -eq 33 ]]
}

status=0
boot 1 || boot 2 || status=1
rm -f "$out/payload.img"
exit $status

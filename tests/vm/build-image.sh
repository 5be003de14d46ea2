#!/usr/bin/env bash
# Builds what the guest boots from: kernel, initrd and root file system of Debian 12, with the modules that Debian does
# not ship built (gpio-sim, v4l2loopback). Nothing is installed on this machine. Nothing is done while this script is the
# one that built what is there. Exit 77: a tool, root or the network is missing, and standard error says which.
#   build-image.sh [FOLDER]     FOLDER: ${GRANARY_VM_CACHE:-~/.cache/granary-vm}
set -euo pipefail

packages=systemd,systemd-sysv,dbus,udev,kmod,gpiod,v4l-utils,tzdata,mbpoll
modules=(vivid v4l2loopback gpio-sim configfs 9p 9pnet_virtio virtio_pci virtio_blk virtio_rng ext4)
mirror=${GRANARY_VM_MIRROR:-http://deb.debian.org/debian}

self=$(readlink -f "$0")
cache=${1:-${GRANARY_VM_CACHE:-$HOME/.cache/granary-vm}}
stamp=$(sha256sum <"$self" | cut -d' ' -f1)
[[ $(cat "$cache/stamp" 2>/dev/null) != "$stamp" ]] || exit 0

skip() {
  echo "build-image: $*" >&2
  exit 77
}

if [[ -z ${GRANARY_VM_NAMESPACE:-} ]]; then
  declare -A package_of=([mmdebstrap]=mmdebstrap [mke2fs]=e2fsprogs [modprobe]=kmod [cpio]=cpio [make]=make [gcc-12]=gcc-12
    [xz]=xz-utils [unshare]=util-linux [dpkg-deb]=dpkg [apt-get]=apt [flock]=util-linux)
  PATH=$PATH:/sbin:/usr/sbin
  missing=()
  for tool in "${!package_of[@]}"; do
    command -v "$tool" >/dev/null || missing+=("${package_of[$tool]}")
  done
  # Debian's objtool, which makes modules, is linked with it.
  [[ $(ldconfig -p 2>/dev/null) == *'libelf.so.1 '* ]] || missing+=(libelf1)
  [[ ${#missing[@]} -eq 0 ]] || skip "missing, as root: apt-get install ${missing[*]}"
  [[ $(id -u) -eq 0 ]] || skip "the image has to be built once as root: sudo GRANARY_VM_CACHE=$cache $self"
  # Whatever mmdebstrap mounts goes with this namespace, however the script ends.
  unshare --mount --pid --fork true 2>/dev/null || skip "this root may not make mount and process namespaces"
  mkdir -p "$cache"
  exec env GRANARY_VM_NAMESPACE=1 flock "$cache" \
    unshare --mount --pid --fork --kill-child --mount-proc "$self" "$cache"
fi

work=$cache/work
mkdir -p "$work"
mount -t tmpfs -o size=4G,mode=755 granary-vm "$work"
cd "$work"
mkdir packages kernel initrd.d apt apt/lists apt/lists/partial apt/archives
step() { echo "build-image: $SECONDS s: $*" >&2; }

# The guest's own package lists, so that neither this machine's sources nor their age matter.
keyring=/usr/share/keyrings/debian-archive-keyring.gpg
cat >apt/sources.list <<END
deb [signed-by=$keyring] $mirror bookworm main
deb [signed-by=$keyring] ${mirror%/debian}/debian-security bookworm-security main
END
apt_options=(-o Dir::State::Lists="$work/apt/lists" -o Dir::Etc::SourceList="$work/apt/sources.list"
  -o Dir::Etc::SourceParts=/dev/null -o Dir::Cache="$work/apt" -o APT::Sandbox::User=root -o APT::Architecture=amd64
  -o APT::Architectures=amd64)
apt-get -qq "${apt_options[@]}" -o APT::Update::Error-Mode=any update >apt/log 2>&1 ||
  skip "no packages from $mirror (GRANARY_VM_MIRROR): $(tail -n1 apt/log)"
field() { apt-cache "${apt_options[@]}" show --no-all-versions linux-headers-amd64 | sed -n "s/^$1: //p"; }
version=$(field Version)
kernel=$(field Depends | sed -n 's/^linux-headers-\([^ ]*\).*/\1/p')
step "kernel $kernel ($version)"

# The root file system takes longest and needs nothing else.
mmdebstrap --quiet --variant=minbase --architectures=amd64 --include="$packages" \
  --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
  --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt=force-unsafe-io \
  bookworm "$work/root" apt/sources.list >root.log 2>&1 &
root_builder=$!

(cd packages && apt-get -qq "${apt_options[@]}" download "linux-image-$kernel" "linux-headers-$kernel=$version" \
  "linux-headers-${kernel%-amd64}-common=$version" "linux-kbuild-6.1=$version" "linux-source-6.1=$version" \
  v4l2loopback-dkms busybox-static >../apt/log 2>&1) || skip "cannot download the kernel: $(tail -n1 apt/log)"
for package in packages/linux-{image,headers,kbuild}*.deb packages/busybox*.deb packages/v4l2*.deb; do
  dpkg-deb -x "$package" kernel
done
step "packages there"

# The headers run from where they are unpacked: one absolute path changes.
headers=$work/kernel/usr/src/linux-headers-$kernel
sed -i "s#include /usr/src/#include $work/kernel/usr/src/#" "$headers/Makefile"
mkdir gpio-sim
dpkg-deb --fsys-tarfile packages/linux-source-6.1_*.deb | tar -xO ./usr/src/linux-source-6.1.tar.xz | xz -dc -T0 |
  tar -x -C gpio-sim --strip-components=3 linux-source-6.1/drivers/gpio/{gpio-sim.c,gpiolib.h} \
    linux-source-6.1/kernel/irq/irq_sim.c
# Debian's kernel has no simulated interrupts and exports no irq_to_desc(): irq_sim.c becomes part of the module and
# uses the call that is exported.
mv gpio-sim/gpio-sim.c gpio-sim/main.c
sed -i 's/handle_simple_irq(irq_to_desc(irqnum))/generic_handle_domain_irq(work_ctx->domain, offset)/
        /irqnum = irq_find_mapping/d; /^\tint irqnum;$/d; /^EXPORT_SYMBOL_GPL/d' gpio-sim/irq_sim.c
printf 'obj-m := gpio-sim.o\ngpio-sim-y := main.o irq_sim.o\n' >gpio-sim/Kbuild
loopback=$(echo kernel/usr/src/v4l2loopback-*)
# It stamps frames by the monotonic clock and does not say so, which a camera that runs free has to; and it skips to the
# newest frame when its reader is two behind, where a camera keeps as many as there are buffers.
sed -i 's/b->flags = 0;/b->flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;/
        s/opener->read_position + 2)/opener->read_position + dev->used_buffers - 1)/' "$loopback/v4l2loopback.c"
grep -q 'b->flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;' "$loopback/v4l2loopback.c"
grep -q 'opener->read_position + dev->used_buffers - 1)' "$loopback/v4l2loopback.c"
for source in gpio-sim "$loopback"; do
  make -s -C "$headers" M="$work/$source" modules >"${source##*/}.log" 2>&1 || {
    cat "${source##*/}.log" >&2
    exit 1
  }
done
cp gpio-sim/gpio-sim.ko "$loopback/v4l2loopback.ko" "kernel/lib/modules/$kernel/kernel/"
depmod -b kernel "$kernel"
files_of() { modprobe -S "$kernel" -d kernel -a --show-depends "$@" | sed -n 's#^insmod ##p' | awk '!seen[$0]++'; }
step "modules built"

mkdir -p initrd.d/{bin,modules,dev,proc,root}
cp kernel/bin/busybox initrd.d/bin/
number=100
# 9pnet_virtio as well: loaded by the mount itself, it may look for the host's folder before its device is there.
for module in $(files_of virtio_pci virtio_blk 9pnet_virtio crc32c_generic ext4); do
  cp "$module" "initrd.d/modules/$((number++))-${module##*/}"
done
cat >initrd.d/init <<'END'
#!/bin/busybox sh
/bin/busybox mount -t devtmpfs dev /dev
/bin/busybox mount -t proc proc /proc
for module in /modules/*; do /bin/busybox insmod $module; done
while ! /bin/busybox mount -t ext4 -o noatime /dev/vda /root 2>/dev/null; do /bin/busybox sleep 0.05; done
/bin/busybox mount --move /dev /root/dev
/bin/busybox umount /proc
exec /bin/busybox switch_root /root /sbin/init
END
chmod +x initrd.d/init
(cd initrd.d && find . | cpio -o -H newc -R 0:0 --quiet) >initrd

wait $root_builder || {
  tail -n20 root.log >&2
  skip "mmdebstrap failed"
}
step "root file system there"
for module in $(files_of "${modules[@]}"); do
  install -Dm644 "$module" "root/lib/modules/$kernel/${module#*/lib/modules/"$kernel"/}"
done
cp "kernel/lib/modules/$kernel/"modules.{order,builtin,builtin.modinfo} "root/lib/modules/$kernel/"
depmod -b root "$kernel"
echo granary-vm >root/etc/hostname
echo 0123456789abcdef0123456789abcdef >root/etc/machine-id
mkdir root/host root/opt/granary
cat >root/etc/fstab <<'END'
host /host 9p trans=virtio,version=9p2000.L,msize=262144,access=any 0 0
/dev/vdb /opt/granary ext4 ro 0 0
END
echo /opt/granary/lib >root/etc/ld.so.conf.d/granary.conf
cat >root/etc/systemd/system/vm-test.service <<'END'
[Unit]
Description=The test that the host brought along
RequiresMountsFor=/host /opt/granary
After=systemd-udev-settle.service

[Service]
Type=oneshot
ExecStart=/bin/bash /opt/granary/guest/main.sh
# The verdict leaves the guest as the exit status of QEMU, 2 n + 1: 33 passed, 35 failed.
ExecStopPost=/bin/sh -c 'sync; [ "$SERVICE_RESULT" = success ] && n="\\020" || n="\\021"; printf "$n" | dd of=/dev/port bs=1 seek=1281 status=none'
StandardOutput=journal+console
StandardError=journal+console
TimeoutStartSec=infinity
END
mkdir -p root/etc/systemd/system/multi-user.target.wants
ln -s ../vm-test.service root/etc/systemd/system/multi-user.target.wants/
for unit in getty.target console-getty.service serial-getty@.service apt-daily.timer apt-daily-upgrade.timer \
  dpkg-db-backup.timer e2scrub_all.timer e2scrub_reap.service fstrim.timer systemd-update-utmp.service \
  systemd-update-utmp-runlevel.service systemd-pcrphase.service systemd-binfmt.service systemd-timesyncd.service; do
  ln -sf /dev/null "root/etc/systemd/system/$unit"
done
# What the guest has of its own must not be brought along.
(cd root/usr/lib/x86_64-linux-gnu && printf '%s\n' *.so.*) >libraries

rm -f "$cache/stamp"
# Sparse, with 300 MB to write to in a run; the file itself never changes (snapshot=on).
mke2fs -q -F -t ext4 -O ^has_journal,^metadata_csum -m 0 -d root root.img "$(($(du -sm root | cut -f1) * 11 / 10 + 300))M"
cp --sparse=always root.img "$cache/root.img"
cp "kernel/boot/vmlinuz-$kernel" "$cache/vmlinuz"
cp initrd libraries "$cache/"
echo "$stamp" >"$cache/stamp"
step "done, $(du -sm --exclude=work "$cache" | cut -f1) MB in $cache"

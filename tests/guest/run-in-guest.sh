#!/bin/bash
# Run a command in a throw-away Linux guest that has a real SocketCAN kernel (vcan, vxcan, slcan, can-gw, ...).
#   run-in-guest.sh [-b uml|qemu|qemu-rt] [-t SECONDS] [-m MIB] [-q QEMU_OPTION]... PROJECT_DIR COMMAND [ARG]...
# The guest's root is this machine's own root, copy-on-write in memory, so the same Python, virtual
# environments and tools are there; PROJECT_DIR is at /mnt/project, read-write and shared, and is the
# working directory. COMMAND runs as root with this environment; its stdout and stderr come out here,
# and its exit code is ours (124: time limit, 125: the guest failed; the guest's console is then shown).
# uml: user-mode Linux, quick (one CPU).  qemu: emulated PC (slow), two kvaser_pci CAN cards on one bus
# (modprobe kvaser_pci gives can0 and can1).  qemu-rt: the same with a PREEMPT_RT kernel.
set -euo pipefail
backend=uml limit=300 mem=512 extra=() preload= cache=${GUEST_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/ahdc-fieldkit/guest}
while getopts b:t:m:q: o; do case $o in
  b) backend=$OPTARG ;; t) limit=$OPTARG ;; m) mem=$OPTARG ;; q) read -ra x <<<"$OPTARG"; extra+=("${x[@]}") ;; *) exit 2 ;;
esac; done
shift $((OPTIND - 1)); [ $# -ge 2 ] || { sed -n '2,11s/^# \{0,1\}//p' "$0"; exit 2; }
project=$(realpath "$1"); shift; mkdir -p "$cache"; cache=$(realpath "$cache")

install() { # install PROGRAM PACKAGE...: the packages, unless the program is there
  command -v "$1" >/dev/null && return; shift; apt-get -qq update >&2
  DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "$@" >&2
}
unpack() { # unpack PACKAGE DIR TAR_OPTION...: part of a package's files, without installing it
  local pkg=$1 dir=$2 tmp; shift 2; rm -rf "$dir" "$dir.new"; mkdir "$dir.new"; tmp=$(mktemp -d)
  apt-cache show "$pkg" >/dev/null 2>&1 || apt-get -qq update >&2
  (cd "$tmp"; apt-get -qq -o APT::Sandbox::User=root download "$pkg" >&2; dpkg-deb --fsys-tarfile ./*.deb | tar xC "$dir.new" "$@")
  rm -rf "$tmp"
}
exec 9>"$cache/lock"; flock 9 # one download at a time
install cansend can-utils; install ip iproute2; install modprobe kmod; install busybox busybox-static
case $backend in
uml)
  g=$cache/uml kernel=$cache/uml/usr/bin/linux.uml
  if [ ! -d "$g" ]; then unpack user-mode-linux "$g" ./usr/bin ./usr/lib/uml; mv "$g.new"/usr/lib/uml "$g.new/lib"; mv "$g.new" "$g"; fi
  if grep -qw amx_tile /proc/cpuinfo; then # see xstate.c
    source=$(dirname "$(realpath "$0")")/xstate.c preload=$cache/xstate.so
    if [ ! "$preload" -nt "$source" ]; then
      install cc gcc libc6-dev; cc -O2 -shared -fPIC -o "$preload.new" "$source"; mv "$preload.new" "$preload"
    fi
  fi ;;
qemu|qemu-rt)
  install qemu-system-x86_64 qemu-system-x86
  meta=linux-image-${backend#qemu}-amd64; meta=${meta/--/-}; g=$cache/$backend kernel=$g/vmlinux
  if [ ! -d "$g" ]; then
    apt-cache show "$meta" >/dev/null 2>&1 || apt-get -qq update >&2
    k=lib/modules/*/kernel
    unpack "$(apt-cache depends "$meta" | awk '/Depends: linux-image/ {print $2}')" "$g" --wildcards ./boot './lib/modules/*/modules.*' \
      ./$k/{net,fs,lib,crypto,drivers/{virtio,char,block,hid,i2c,input,tty,usb,net/can}}
    n=$g.new ver=$(ls "$g.new/lib/modules"); depmod -b "$n" "$ver"; img=$n/boot/vmlinuz-$ver
    # the kernel without its XZ shell: an emulated CPU would take seconds to unpack it
    tail -c+$((1 + $(LC_ALL=C grep -aboP '\xFD7zXZ\0' "$img" | head -n1 | cut -d: -f1))) "$img" | xz -dcq >"$n/vmlinux" 2>/dev/null || :
    i=$n/initrd; mkdir -p "$i"/{host,proc,lib/modules/"$ver"}; cp "$(command -v busybox)" "$i"
    modprobe -d "$n" -S "$ver" -aD virtio_pci 9pnet_virtio 9p | awk '/^insmod/ && !seen[$2]++ {print $2}' >"$n/list"
    while read -r m; do cp "$m" "$i/lib/modules"; done <"$n/list"
    { echo '#!/busybox sh'; sed 's,.*/,/busybox insmod /lib/modules/,' "$n/list"; cat <<'E'
/busybox mount -t proc p /proc; for a in $(/busybox cat /proc/cmdline); do case $a in guest=*) i=${a#guest=} ;; esac; done
/busybox mount -t 9p -o ro,trans=virtio,version=9p2000.L,cache=loose,msize=512000 root /host
exec /busybox switch_root /host "$i"
E
    } >"$i/init"; chmod +x "$i/init"; (cd "$i"; find . | busybox cpio -o -H newc 2>/dev/null) >"$n/initrd.img"; mv "$n" "$g"
  fi ;;
*) echo "unknown guest: $backend" >&2; exit 2 ;;
esac
flock -u 9

find "$cache" -maxdepth 1 -name 'run.*' -mmin +1440 -exec rm -rf {} + # of runs killed with SIGKILL
run=$(mktemp -d "$cache/run.XXXXXX") guest=
trap '[ -z "$guest" ] || { kill -9 "$guest"; wait "$guest"; } 2>/dev/null || :; rm -rf "$run"' EXIT; trap 'exit 143' TERM INT HUP
export -p >"$run/env"; printf '%q ' "$@" >"$run/command"
share() { if [ "$backend" = uml ]; then echo "mount -t hostfs -o '$2' none"; else echo "mount -t 9p -o trans=virtio,version=9p2000.L,cache=mmap,msize=512000 $1"; fi; }
cat >"$run/init" <<E
#!/bin/bash
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc; mount -t tmpfs tmpfs /mnt; mkdir /mnt/{up,work,root}
modprobe -d '$g' -a overlay; modprobe -d '$g' -q virtio_console
mount -t overlay -o lowerdir=/,upperdir=/mnt/up,workdir=/mnt/work overlay /mnt/root; cd /mnt/root; mkdir -p lib/modules mnt/project mnt/run
mount --bind '$g/lib/modules' lib/modules; $(share project "$project") mnt/project; $(share run "$run") mnt/run
mount -t proc proc proc; mount -t sysfs sysfs sys; mount -t devtmpfs dev dev; mkdir -p dev/pts dev/shm
mount -t devpts devpts dev/pts; mount -t tmpfs shm dev/shm; mount -t tmpfs run run; ln -sf /proc/self/fd dev/fd
exec chroot . /bin/bash -c 'ip link set lo up; [ -e /dev/vport0p1 ] && exec 3>/dev/vport0p1 || { exec 3>/dev/ttyS0; stty -F /dev/ttyS0 raw; }
  mkfifo /run/out; cat /run/out >&3 & # a pipe, not a terminal; given 2 s to empty where a left-over process holds it
  (. /mnt/run/env; cd /mnt/project; eval "\$(cat /mnt/run/command)") </dev/null >/run/out 2>&1 3>&-; echo \$? >/mnt/run/rc
  timeout 2 tail -s .1 --pid=\$! -f /dev/null; sync; exec 3>&-; exec busybox poweroff -f'
E
chmod +x "$run/init"
if [ "$backend" = uml ]; then
  vm=(env ${preload:+LD_PRELOAD="$preload"} "$kernel" "mem=${mem}M" root=/dev/root rootfstype=hostfs ro "init=$run/init" "uml_dir=$run/" con=null con0=null,fd:3 ssl0=null,fd:1)
else
  vm=(qemu-system-x86_64 -accel tcg -cpu max -smp 1 -m "$mem" -M pc -nodefaults -no-user-config -no-reboot -display none -serial file:"$run/console"
    -kernel "$kernel" -initrd "$g/initrd.img" -append "console=ttyS0 panic=-1 mitigations=off guest=$run/init"
    -chardev stdio,id=out,signal=off -device virtio-serial-pci -device virtserialport,chardev=out
    -virtfs local,path=/,mount_tag=root,security_model=none,readonly=on,multidevs=remap
    -virtfs "local,path=$project,mount_tag=project,security_model=none,multidevs=remap" -virtfs "local,path=$run,mount_tag=run,security_model=none"
    -object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus "${extra[@]}")
fi
mkfifo "$run/stdin" # never written, never at its end (QEMU takes an end of input for a hang-up)
# a PID namespace that dies with us: nothing is left behind, whatever happens
setpriv --pdeathsig KILL unshare --pid --fork --kill-child timeout -k 5 "$limit" "${vm[@]}" 0<>"$run/stdin" 2>"$run/stderr" 3>"$run/console" 9>&- &
guest=$!; status=0; wait "$guest" || status=$?; guest=
[ -s "$run/rc" ] && exit "$(cat "$run/rc")"
tail -n 40 "$run/console" "$run/stderr" >&2; [ "$status" = 124 ] && exit 124; exit 125

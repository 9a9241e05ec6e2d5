"""Which file system a folder is on, so that a ledger is never kept where locks and fsync do not hold."""

import re
from dataclasses import dataclass
from pathlib import Path

from labctl.errors import BadInput

_MOUNTS = Path("/proc/self/mountinfo")

# File systems that other machines write too, or whose server decides what fsync and a lock mean. SQLite's WAL needs
# memory that all its users share (https://www.sqlite.org/wal.html).
_NETWORK_TYPES = """
    nfs nfs4 cifs smb2 smb3 smbfs ncpfs afs coda ceph glusterfs lustre beegfs beegfs_nodev gpfs orangefs pvfs2 gfs
    gfs2 ocfs2 9p davfs acfs vboxsf vmhgfs prl_fs fuse.sshfs fuse.glusterfs fuse.ceph fuse.ceph-fuse fuse.s3fs
    fuse.rclone fuse.gcsfuse fuse.goofys fuse.juicefs fuse.davfs2 fuse.smbnetfs fuse.curlftpfs fuse.gvfsd-fuse
    fuse.vmhgfs-fuse fuse.moosefs fuse.mfs fuse.seaweedfs fuse.lizardfs
"""
NETWORK = frozenset(_NETWORK_TYPES.split())


@dataclass(frozen=True)
class Mount:
    """A mounted file system: where, of what type, from what source."""

    point: Path
    type: str
    source: str


def mount_of(folder: Path, mountinfo: str) -> Mount | None:
    """The mount that an absolute folder lies on, by the text of /proc/self/mountinfo (proc(5)); None where none fits.

    The longest mount point counts, and of several on one point the last, which hides the others.
    """
    found: Mount | None = None
    for line in mountinfo.splitlines():
        before, _, after = line.partition(" - ")
        left, right = before.split(" "), after.split(" ")
        if len(left) < 5 or len(right) < 2:
            continue
        mount = Mount(Path(_unescaped(left[4])), _unescaped(right[0]), _unescaped(right[1]))
        if folder.is_relative_to(mount.point) and (
            found is None or len(mount.point.parts) >= len(found.point.parts)
        ):
            found = mount
    return found


def refuse_network(folder: Path) -> None:
    """Refuse a folder on a network file system. Where there is no /proc nothing is known, and nothing is refused.

    Raises:
        BadInput: the folder is on one.
    """
    try:
        mountinfo = _MOUNTS.read_text(encoding="utf-8", errors="surrogateescape")
        place = folder.resolve()
    except (OSError, RuntimeError):
        return
    mount = mount_of(place, mountinfo)
    if mount is not None and mount.type in NETWORK:
        raise BadInput(
            f"ledger {folder}: {mount.point} is a network file system ({mount.type}, {mount.source}), where a "
            "ledger can be damaged and two writers can meet; name a folder on a disk of this machine with "
            "--ledger, and copy it over when nothing writes"
        )


def _unescaped(text: str) -> str:
    return re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), text)

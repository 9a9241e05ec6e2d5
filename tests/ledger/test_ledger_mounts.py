from pathlib import Path

import pytest
from made_ledger import no_notice

from labctl.errors import BadInput
from labctl.ledger.store import mounts
from labctl.ledger.store.mounts import mount_of, refuse_network
from labctl.ledger.writer import LedgerWriter

MOUNTINFO = r"""22 27 0:21 / /proc rw,relatime - proc proc rw
27 1 254:0 / / rw,relatime shared:1 - ext4 /dev/vda rw,discard
40 27 0:50 / /home rw,relatime shared:2 master:1 - nfs4 server:/export/home rw,vers=4.2
41 40 0:51 / /home/ada/scratch rw,relatime - xfs /dev/sdb1 rw
42 27 0:52 / /mnt/lab\040share rw - cifs //nas/lab\040share rw
43 27 0:53 / /data rw - ext4 /dev/sdc1 rw
44 43 0:54 / /data rw - fuse.sshfs ada@far:/data rw
"""


@pytest.mark.parametrize(
    ("folder", "point", "type_", "source"),
    [
        ("/srv/ledger", "/", "ext4", "/dev/vda"),
        ("/homestead", "/", "ext4", "/dev/vda"),
        ("/home", "/home", "nfs4", "server:/export/home"),
        ("/home/ada/ledger", "/home", "nfs4", "server:/export/home"),
        ("/home/ada/scratch/ledger", "/home/ada/scratch", "xfs", "/dev/sdb1"),
        ("/mnt/lab share/a", "/mnt/lab share", "cifs", "//nas/lab share"),
        ("/data/a", "/data", "fuse.sshfs", "ada@far:/data"),
    ],
)
def test_the_mount_that_a_folder_is_on(folder, point, type_, source):
    mount = mount_of(Path(folder), MOUNTINFO)

    assert (str(mount.point), mount.type, mount.source) == (point, type_, source)


def test_a_ledger_on_a_network_file_system_is_refused(tmp_path, monkeypatch):
    info = tmp_path / "mountinfo"
    info.write_text(rf"1 1 0:1 / {tmp_path}/share rw - nfs4 nas:/lab rw" + "\n")
    monkeypatch.setattr(mounts, "_MOUNTS", info)
    (tmp_path / "share").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "share")

    for folder in (tmp_path / "share" / "ledger", tmp_path / "link" / "ledger"):
        with pytest.raises(BadInput, match=rf"{tmp_path}/share is a network file system \(nfs4, nas:/lab\)"):
            LedgerWriter.open(folder, no_notice)
        assert not folder.exists()
    refuse_network(tmp_path / "local")


def test_where_mounts_cannot_be_read_nothing_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(mounts, "_MOUNTS", tmp_path / "nowhere")

    refuse_network(tmp_path)

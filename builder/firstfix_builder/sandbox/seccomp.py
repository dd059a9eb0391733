"""A seccomp filter: system calls that a build does not need fail with EPERM.

It lists the refused calls, not the allowed ones: the libraries of a build (open3d, TBB, BLAS, glibc) make
other calls in every release, and a container adds its own profile. It is written as BPF, because the images
have no libseccomp.
"""

from __future__ import annotations

import ctypes
import errno
import platform
import struct

from .kernel import prctl

_SET_SECCOMP, _MODE_FILTER = 22, 2
_ALLOW, _KILL_PROCESS, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
# offsets in struct seccomp_data; an argument's low half, both machines being little-endian
_NUMBER, _ARCH, _ARGUMENT_0, _ARGUMENT_1 = 0, 4, 16, 24
_X32 = 0x40000000  # x86-64's second table of system calls
_NEW_NAMESPACES = 0x7E020080  # CLONE_NEW*
_AF_UNIX = 1
_TERMINAL_INPUT = (0x5412, 0x541C)  # TIOCSTI, TIOCLINUX: they type into a terminal
_MACHINES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}  # column below, AUDIT_ARCH_*

# name: (x86-64, aarch64)
_REFUSED: dict[str, tuple[int | None, int | None]] = {
    # the network, also by io_uring, which no filter sees into
    "socket": (41, 198),
    "connect": (42, 203),
    "bind": (49, 200),
    "listen": (50, 201),
    "accept": (43, 202),
    "accept4": (288, 242),
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
    # other processes
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "process_madvise": (440, 440),
    "pidfd_getfd": (438, 438),
    "pidfd_send_signal": (424, 424),
    "kcmp": (312, 272),
    # out of the group and the session by which a build is ended
    "setsid": (112, 157),
    "setpgid": (109, 154),
    # memory that stays when the build has ended
    "shmget": (29, 194),
    "shmat": (30, 196),
    "msgget": (68, 186),
    "semget": (64, 190),
    "mq_open": (240, 180),
    # a file by its path, which Landlock sees only from Linux 6.2 on
    "truncate": (76, 45),
    # namespaces, mounts, other ways to files
    "unshare": (272, 97),
    "setns": (308, 268),
    "chroot": (161, 51),
    "pivot_root": (155, 41),
    "mount": (165, 40),
    "umount2": (166, 39),
    "move_mount": (429, 429),
    "open_tree": (428, 428),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
    "name_to_handle_at": (303, 264),
    "open_by_handle_at": (304, 265),
    "mknod": (133, None),
    "mknodat": (259, 33),
    "fanotify_init": (300, 262),
    "acct": (163, 89),
    "quotactl": (179, 60),
    "quotactl_fd": (443, 443),
    "swapon": (167, 224),
    "swapoff": (168, 225),
    # the kernel's own insides
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "keyctl": (250, 219),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "init_module": (175, 105),
    "finit_module": (313, 273),
    "delete_module": (176, 106),
    "kexec_load": (246, 104),
    "kexec_file_load": (320, 294),
    "reboot": (169, 142),
    "syslog": (103, 116),
    "personality": (135, 92),
    "settimeofday": (164, 170),
    "clock_settime": (227, 112),
    "clock_adjtime": (305, 266),
    "adjtimex": (159, 171),
    "sethostname": (170, 161),
    "setdomainname": (171, 162),
    "iopl": (172, None),
    "ioperm": (173, None),
}
_CLONE, _CLONE3, _SOCKETPAIR, _IOCTL = (56, 220), (435, 435), (53, 199), (16, 29)


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("code", ctypes.c_char_p))


def refuse_system_calls() -> None:
    """Refuse the system calls to this process and its children, permanently. Needs PR_SET_NO_NEW_PRIVS.

    Raises:
        OSError: the kernel has no seccomp, or this module has no table for this machine.
    """
    if platform.machine() not in _MACHINES:
        raise OSError(errno.ENOSYS, f"no table of system calls for {platform.machine()}")
    code = filter_program(platform.machine())
    program = _Program(len(code) // 8, code)
    prctl(_SET_SECCOMP, _MODE_FILTER, ctypes.addressof(program))


def filter_program(machine: str) -> bytes:
    """The filter as BPF code, with eight bytes for each instruction."""
    column, arch = _MACHINES[machine]
    refuse = _return(_ERRNO | errno.EPERM)
    steps = [_load(_ARCH), _skip_unless_equal(arch, 0, 1), _skip_always(1), _return(_KILL_PROCESS)]
    steps += [_load(_NUMBER), _instruction(0x35, _X32, 0, 1), refuse]  # from x32's first on
    for numbers in _REFUSED.values():
        number = numbers[column]
        if number is not None:
            steps += [_skip_unless_equal(number, 0, 1), refuse]
    # glibc takes clone when there is no clone3, whose flags a filter cannot see
    steps += [_skip_unless_equal(_CLONE3[column], 0, 1), _return(_ERRNO | errno.ENOSYS)]
    steps += [_skip_unless_equal(_CLONE[column], 0, 4), _load(_ARGUMENT_0)]
    steps += [_instruction(0x45, _NEW_NAMESPACES, 0, 1), refuse, _return(_ALLOW)]  # any of these bits
    steps += [_skip_unless_equal(_SOCKETPAIR[column], 0, 4), _load(_ARGUMENT_0)]
    steps += [_skip_unless_equal(_AF_UNIX, 1, 0), refuse, _return(_ALLOW)]
    steps += [_skip_unless_equal(_IOCTL[column], 0, 4), _load(_ARGUMENT_1)]
    steps += [
        _skip_unless_equal(_TERMINAL_INPUT[0], 1, 0),
        _skip_unless_equal(_TERMINAL_INPUT[1], 0, 1),
        refuse,
    ]
    return b"".join([*steps, _return(_ALLOW)])


def _instruction(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    return struct.pack("=HBBI", code, if_true, if_false, value)


def _load(offset: int) -> bytes:
    return _instruction(0x20, offset)


def _skip_always(steps: int) -> bytes:
    return _instruction(0x05, steps)


def _skip_unless_equal(value: int, if_equal: int, if_not: int) -> bytes:
    return _instruction(0x15, value, if_equal, if_not)


def _return(verdict: int) -> bytes:
    return _instruction(0x06, verdict)

/* Lets user-mode Linux 6.1 run where the processor's register file is larger than that kernel knows (AMX).
 *
 * The host refuses PTRACE_SETREGSET of NT_X86_XSTATE unless the whole area is given; the guest kernel gives the
 * part it knows. Preloaded under the guest kernel, this completes that part with the thread's present contents.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { NT_X86_XSTATE = 0x202 };

static long complete_and_set(pid_t pid, const struct iovec *part)
{
	static unsigned char area[65536];
	struct iovec whole = {area, sizeof area};

	if (syscall(SYS_ptrace, PTRACE_GETREGSET, pid, NT_X86_XSTATE, &whole) < 0 || whole.iov_len < part->iov_len)
		return -1;
	memcpy(area, part->iov_base, part->iov_len);
	return syscall(SYS_ptrace, PTRACE_SETREGSET, pid, NT_X86_XSTATE, &whole);
}

long ptrace(enum __ptrace_request request, ...)
{
	va_list arguments;
	va_start(arguments, request);
	pid_t pid = va_arg(arguments, pid_t);
	void *address = va_arg(arguments, void *);
	void *data = va_arg(arguments, void *);
	va_end(arguments);

	int peeks = request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER;
	long word, result = syscall(SYS_ptrace, request, pid, address, peeks ? (void *)&word : data);

	if (peeks && result >= 0) {
		errno = 0;
		return word;
	}
	if (result < 0 && request == PTRACE_SETREGSET && (long)address == NT_X86_XSTATE)
		return complete_and_set(pid, data);
	return result;
}
